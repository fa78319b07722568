"""Signature of webhooks: HMAC-SHA256 over id, time and body, in the headers that Standard Webhooks names. Pure."""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
from typing import Final

ID: Final = "webhook-id"
TIMESTAMP: Final = "webhook-timestamp"
SIGNATURE: Final = "webhook-signature"
_PREFIX: Final = "whsec_"


def key_of(secret: str) -> bytes:
    """Key behind a secret: what ``whsec_`` and base64 stand for, or else the text itself as UTF-8."""
    if secret.startswith(_PREFIX):
        try:
            return base64.b64decode(secret.removeprefix(_PREFIX), validate=True)
        except binascii.Error:
            pass
    return secret.encode()


def sign(secret: str, message_id: str, timestamp: int, body: bytes) -> str:
    """Signature of a body that is sent at ``timestamp``, UTC s: ``v1,`` and base64."""
    signed = b".".join([message_id.encode(), str(timestamp).encode(), body])
    return "v1," + base64.b64encode(hmac.digest(key_of(secret), signed, hashlib.sha256)).decode()


def headers(secret: str | None, message_id: str, timestamp: int, body: bytes) -> dict[str, str]:
    """Headers of one attempt; without a secret there is no signature."""
    found = {ID: message_id, TIMESTAMP: str(timestamp)}
    if secret is not None:
        found[SIGNATURE] = sign(secret, message_id, timestamp, body)
    return found
