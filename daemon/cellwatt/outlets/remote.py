"""The server that an outlet sends to: trusted authorities, reasons of failures, and when to try again."""

from __future__ import annotations

import math
import socket
import ssl
from datetime import datetime
from email.utils import parsedate_to_datetime
from pathlib import Path
from typing import Final

from cellwatt.errors import OutletError, why

LONGEST_WAIT: Final = 3600.0
"""Longest wait that a server may request, s."""
_BY_CLOCK: Final = (9, 10)
"""OpenSSL's codes of a certificate that is not valid yet, and of an expired one."""
_ADVICE: Final = {
    "PROTOCOL": "it must speak TLS 1.2 or later",
    "ALERT": "the server refuses this PC: check certificate and key",
    "": "is this a port for TLS?",
}
"""Advice by a word in OpenSSL's reason."""


class NotNowError(OutletError):
    """The peer accepts nothing now; ``wait`` is the time, s, after which to try again, if the peer gives one."""

    def __init__(self, reason: str, wait: float | None = None) -> None:
        super().__init__(reason)
        self.wait = wait


class RefusedError(OutletError):
    """The peer refuses a message for good."""


def trust(ca: Path | None) -> ssl.SSLContext:
    """A TLS context that trusts an authority (PEM), or those of the system. Reads files. Raises ``NotNowError``."""
    try:
        context = ssl.create_default_context(cafile=ca)
    except ssl.SSLError as error:
        raise NotNowError(f"ca: {ca} is not a certificate authority: {error.reason}") from None
    except OSError as error:
        raise NotNowError(f"ca: {ca} cannot be read: {why(error)}") from None
    context.minimum_version = ssl.TLSVersion.TLSv1_2
    return context


def unreached(error: Exception) -> str:
    """Reason why a connection failed, as text. aiohttp's errors contain the system's errors."""
    inner = getattr(error, "certificate_error", None) or getattr(error, "os_error", error)
    if isinstance(inner, socket.gaierror):
        return "the host name is not known"
    if isinstance(inner, ssl.SSLCertVerificationError):
        clock = "; is the clock of this PC right?" if inner.verify_code in _BY_CLOCK else ""
        return f"its certificate is not trusted: {inner.verify_message}{clock}"
    if isinstance(inner, ssl.SSLError):
        advice = next(advice for word, advice in _ADVICE.items() if word in str(inner.reason))
        return f"TLS failed: {inner.reason or inner.strerror}; {advice}"
    return (why(inner) if isinstance(inner, OSError) else "") or f"the connection failed: {type(inner).__name__}"


def wait_of(header: str | None, now: datetime) -> float | None:
    """Wait in s that a ``Retry-After`` header requests as seconds or a date; ``None`` if absent or invalid."""
    if header is None:
        return None
    try:
        seconds = float(header)
    except ValueError:
        try:
            seconds = (parsedate_to_datetime(header) - now).total_seconds()
        except (ValueError, TypeError, OverflowError):
            return None
    return min(max(seconds, 0.0), LONGEST_WAIT) if math.isfinite(seconds) else None
