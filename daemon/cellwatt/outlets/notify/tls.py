"""Trust in servers, made anew for each attempt, so that a renewed authority counts."""

from __future__ import annotations

import asyncio
import ssl
from pathlib import Path

from cellwatt.errors import why
from cellwatt.outlets.notify.answer import FailedError


async def trust(ca: Path | None) -> ssl.SSLContext:
    """Context that trusts an authority, or those of the system. Raises ``FailedError`` if it cannot be read."""
    try:
        return await asyncio.to_thread(ssl.create_default_context, cafile=None if ca is None else str(ca))
    except ssl.SSLError as error:
        raise FailedError(f"ca: {ca} is no certificate authority: {error.reason}") from None
    except OSError as error:
        raise FailedError(f"ca: {ca} cannot be read: {why(error)}") from None


def distrusted(error: OSError) -> str:
    """Reason why a connection failed, in words."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"its certificate is not trusted: {error.verify_message}"
    if isinstance(error, ssl.SSLError):
        return f"TLS failed: {error.reason or error.strerror}"
    return why(error)
