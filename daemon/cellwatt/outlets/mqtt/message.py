"""Messages of an outlet over MQTT."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum, auto

_UNSAFE = re.compile(r"[+#/%$\x00-\x1f\x7f]")


@dataclass(frozen=True, slots=True)
class Message:
    """What is published: an empty retained payload deletes what the broker keeps of a topic."""

    topic: str
    payload: bytes
    qos: int = 0
    retain: bool = False


@dataclass(frozen=True, slots=True)
class Subscription:
    """Topics that are listened to."""

    filter: str
    qos: int


class Order(Enum):
    """The consequence of a message that was heard."""

    BIRTH = auto()
    """Tell everything anew, at once."""
    LEAVE = auto()
    """End this connection: nobody is there who listens."""


def level(name: str) -> str:
    """A name as one level of a topic: ``+ # / % $`` and control characters become ``%XX``."""
    return _UNSAFE.sub(lambda found: f"%{ord(found[0]):02X}", name)
