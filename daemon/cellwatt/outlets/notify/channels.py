"""The channel of a recipient and its answers. A channel's library is loaded when the first one is made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from cellwatt.errors import CellwattError
from cellwatt.outlets.notify.rules import Notification
from cellwatt.outlets.notify.texts import short

LONGEST = 200  # characters of a reason


class RefusedError(CellwattError):
    """The server refuses this message for good."""


@dataclass(frozen=True, slots=True)
class SendResult:
    """The server accepted a message, possibly not for all its addresses.

    ``taken``: accepted addresses; ``refused``: reason of each permanent refusal, by address; ``later``: reason of each
    temporary refusal, by address.
    """

    taken: tuple[str, ...] = ()
    refused: Mapping[str, str] = field(default_factory=dict)
    later: Mapping[str, str] = field(default_factory=dict)


class Channel(Protocol):
    """Sends messages to one recipient."""

    async def send(self, message: Notification) -> SendResult:
        """Try once to send a message. Raises ``RefusedError`` or ``NotNowError``."""
        ...


def cleaned(text: str, secrets: tuple[str, ...]) -> str:
    """A reason in one line, without secrets, shortened."""
    for secret in secrets:
        text = text.replace(secret, "***")
    return short(text, LONGEST)
