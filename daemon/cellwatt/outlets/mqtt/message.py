"""MQTT messages of an outlet."""

from __future__ import annotations

import re
from dataclasses import dataclass
from enum import Enum, auto

_UNSAFE = re.compile(r"[+#/%$\x00-\x1f\x7f]")


@dataclass(frozen=True, slots=True)
class Message:
    """A message to publish. An empty retained payload deletes the retained message of the topic."""

    topic: str
    payload: bytes
    qos: int = 0
    retain: bool = False


@dataclass(frozen=True, slots=True)
class Subscription:
    """A topic filter to subscribe to; unless ``needed``, the outlet works without it."""

    filter: str
    qos: int
    needed: bool = True


class Order(Enum):
    """The action that a received message requires."""

    BIRTH = auto()
    """Publish the birth again at once."""
    LEAVE = auto()
    """End this connection: the primary host is offline."""


def level(name: str) -> str:
    """A name as one level of a topic: ``+ # / % $`` and control characters become ``%XX``."""
    return _UNSAFE.sub(lambda found: f"%{ord(found[0]):02X}", name)
