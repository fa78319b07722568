"""The channel of a recipient. A channel's library is loaded when the first one is made."""

from __future__ import annotations

from typing import Protocol

from cellwatt.outlets.notify.rules import Notification
from cellwatt.outlets.notify.texts import short

LONGEST = 200  # characters of a reason


class Channel(Protocol):
    """Sends messages to one recipient."""

    async def send(self, message: Notification) -> None:
        """Try once to send a message. Raises ``RefusedError`` or ``NotNowError`` unless the server accepts it."""
        ...


def cleaned(text: str, secrets: tuple[str, ...]) -> str:
    """A reason in one line, without secrets, shortened."""
    for secret in secrets:
        text = text.replace(secret, "***")
    return short(text, LONGEST)
