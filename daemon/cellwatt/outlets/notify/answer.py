"""The answer of a channel to one attempt."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol

from cellwatt.errors import CellwattError
from cellwatt.outlets.notify.told import Message

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
    text = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return text if len(text) <= LONGEST else text[: LONGEST - 1] + "…"
