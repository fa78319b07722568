"""Webhooks, ntfy and Home Assistant: one POST with JSON for each message."""

from __future__ import annotations

import asyncio
import base64
import binascii
import hashlib
import hmac
import json
import ssl
import time
from datetime import UTC, datetime
from http import HTTPStatus
from typing import Any, Final

import aiohttp
from pydantic import SecretStr

from cellwatt.outlets.notify.rules import Notification
from cellwatt.outlets.notify.settings import HomeAssistantSettings, NtfySettings, Web, WebhookSettings
from cellwatt.outlets.notify.texts import About, body, payload, severity, subject
from cellwatt.outlets.remote import NotNowError, RefusedError, trust, unreached, wait_of
from cellwatt.version import __version__

ID: Final = "webhook-id"
TIMESTAMP: Final = "webhook-timestamp"
SIGNATURE: Final = "webhook-signature"
_PREFIX: Final = "whsec_"


def key_of(secret: str) -> bytes:
    """Signing key of a secret: the base64 after ``whsec_`` decoded, or else the text as UTF-8."""
    if secret.startswith(_PREFIX):
        try:
            return base64.b64decode(secret.removeprefix(_PREFIX), validate=True)
        except binascii.Error:
            pass
    return secret.encode()


def sign(secret: str, message_id: str, timestamp: int, body: bytes) -> str:
    """Signature of a body sent at ``timestamp``, UTC s: ``v1,`` and base64."""
    signed = b".".join([message_id.encode(), str(timestamp).encode(), body])
    return "v1," + base64.b64encode(hmac.digest(key_of(secret), signed, hashlib.sha256)).decode()


PUSH: Final = 3800
"""Most bytes of a text pushed to telephones; ntfy turns more than 4096 into an attachment."""
_PRIORITY: Final = {"error": 5, "warning": 4, "info": 3, None: 3}
_TAGS: Final = {"error": "rotating_light", "warning": "warning", "info": "information_source", None: "white_check_mark"}
_OURS: Final = (401, 403, 404, 407)
"""Refusals of the sender, not of the message; a correct token or address, or a new rule at the server, ends them.
Proxies answer 404 while the server behind them starts."""
_LATER: Final = (408, 425, 429)


class WebChannel:
    """Posts messages to one address."""

    def __init__(self, settings: Web, about: About, timeout: float) -> None:
        self._settings, self._about, self._timeout = settings, about, timeout

    async def send(self, message: Notification) -> None:
        """See ``Channel.send``."""
        settings = self._settings
        content, head = request(settings, self._about, message, int(time.time()))
        safe = settings.address.startswith("https:")
        context: ssl.SSLContext | bool = await asyncio.to_thread(trust, settings.ca) if safe else True
        try:
            async with (
                aiohttp.ClientSession(
                    timeout=aiohttp.ClientTimeout(total=self._timeout), cookie_jar=aiohttp.DummyCookieJar()
                ) as session,
                session.post(
                    settings.address, data=content, headers=head, ssl=context, allow_redirects=False
                ) as response,
            ):
                judge(response.status, response.headers.get("Retry-After"))
                response.close()  # the body is not needed, and may never end
        except TimeoutError:
            raise NotNowError(f"no answer within {self._timeout:g} s") from None
        except (aiohttp.ClientError, OSError) as error:
            raise NotNowError(unreached(error)) from None


def request(settings: Web, about: About, message: Notification, now: int) -> tuple[bytes, dict[str, str]]:
    """Body and headers of one attempt at ``now``, UTC s; only time stamp and signature differ between attempts."""
    fields: dict[str, Any]
    token: SecretStr | None = None
    if isinstance(settings, NtfySettings):
        fields, token = _ntfy(settings, about, message), settings.token
    elif isinstance(settings, HomeAssistantSettings):
        fields, token = _home_assistant(about, message), settings.token
    else:
        fields = payload(about, message)
    content = json.dumps(fields, sort_keys=True).encode()
    head = {"Content-Type": "application/json", "User-Agent": f"cellwatt/{__version__}"}
    if token is not None:
        head["Authorization"] = f"Bearer {token.get_secret_value()}"
    if isinstance(settings, WebhookSettings):
        head |= {ID: message.id, TIMESTAMP: str(now)}
        if settings.secret is not None:
            head[SIGNATURE] = sign(settings.secret.get_secret_value(), message.id, now, content)
    return content, head


def judge(status: int, retry_after: str | None = None) -> None:
    """Raise ``RefusedError`` or ``NotNowError`` unless the status of an answer means that the message is accepted."""
    if HTTPStatus.OK <= status < HTTPStatus.MULTIPLE_CHOICES:
        return
    known = status in HTTPStatus.__members__.values()
    reason = f"{status} {HTTPStatus(status).phrase}" if known else f"{status}"
    if HTTPStatus.MULTIPLE_CHOICES <= status < HTTPStatus.BAD_REQUEST:
        raise NotNowError(f"{reason}: redirects are not followed; set the final address")
    if status in _OURS:
        raise NotNowError(f"{reason}: are token and address right?")
    if HTTPStatus.BAD_REQUEST <= status < HTTPStatus.INTERNAL_SERVER_ERROR and status not in _LATER:
        raise RefusedError(reason)
    raise NotNowError(reason, wait_of(retry_after, datetime.now(UTC)))


def _ntfy(settings: NtfySettings, about: About, message: Notification) -> dict[str, Any]:
    worst = severity(message)
    fields = {
        "topic": settings.topic.get_secret_value(),
        "title": subject(about, message),
        "message": body(about, message, PUSH),
        "priority": _PRIORITY[worst],
        "tags": [_TAGS[worst]],
        "sequence_id": message.id,  # newer servers replace a message by its repetition
    }
    return fields if about.link is None else {**fields, "click": about.link}


def _home_assistant(about: About, message: Notification) -> dict[str, Any]:
    data = {"tag": message.id}  # telephones replace a message by its repetition
    if about.link is not None:
        data |= {"url": about.link, "clickAction": about.link}
    return {"title": subject(about, message), "message": body(about, message, PUSH), "data": data}
