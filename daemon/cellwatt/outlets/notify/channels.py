"""The channel of a recipient and its answers. The libraries behind it are loaded when one is first made."""

from __future__ import annotations

import asyncio
import ssl
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Protocol

from cellwatt.errors import CellwattError, why
from cellwatt.outlets.notify.rules import Message
from cellwatt.outlets.notify.texts import short

LONGEST = 200  # characters of a reason


class RefusedError(CellwattError):
    """The server will never take this message."""


class FailedError(CellwattError):
    """The server did not take the message now; ``after`` s at the earliest it may."""

    def __init__(self, reason: str, after: float = 0.0) -> None:
        super().__init__(reason)
        self.after = after


@dataclass(frozen=True, slots=True)
class Answer:
    """The server took a message, but for some of its addresses.

    ``taken`` it was for these; ``refused`` are reasons by address, for good; ``later`` reasons by address, for now.
    """

    taken: tuple[str, ...] = ()
    refused: Mapping[str, str] = field(default_factory=dict)
    later: Mapping[str, str] = field(default_factory=dict)


class Channel(Protocol):
    """Brings messages to one recipient."""

    async def send(self, message: Message) -> Answer:
        """Try once to bring a message. Raises ``RefusedError`` or ``FailedError``."""
        ...


def cleaned(text: str, secrets: tuple[str, ...]) -> str:
    """A reason in one line without secrets, shortened."""
    for secret in secrets:
        text = text.replace(secret, "***")
    return short(text, LONGEST)


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
