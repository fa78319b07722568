"""The channel of a recipient and its answers. The libraries behind it are loaded when one is first made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from cellwatt.errors import CellwattError
from cellwatt.outlets.notify.rules import Notification
from cellwatt.outlets.notify.texts import short

LONGEST = 200  # characters of a reason


class RefusedError(CellwattError):
    """The server will never take this message."""


@dataclass(frozen=True, slots=True)
class SendResult:
    """The server took a message, but for some of its addresses.

    ``taken`` it was for these; ``refused`` are reasons by address, for good; ``later`` reasons by address, for now.
    """

    taken: tuple[str, ...] = ()
    refused: Mapping[str, str] = field(default_factory=dict)
    later: Mapping[str, str] = field(default_factory=dict)


class Channel(Protocol):
    """Brings messages to one recipient."""

    async def send(self, message: Notification) -> SendResult:
        """Try once to bring a message. Raises ``RefusedError`` or ``NotNowError``."""
        ...


def cleaned(text: str, secrets: tuple[str, ...]) -> str:
    """A reason in one line without secrets, shortened."""
    for secret in secrets:
        text = text.replace(secret, "***")
    return short(text, LONGEST)
