"""Messages of an outlet over MQTT, and the part that its two formats play."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum, auto
from typing import Any, Protocol

from cellwatt.outlets.past import Archived
from cellwatt.outlets.selection import Row
from cellwatt.results import Event, Result

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


@dataclass(frozen=True, slots=True)
class Labels:
    """Names, units and kinds (``Kind``) of the values in rows."""

    units: Mapping[str, str]
    kinds: Mapping[str, str]


class Format(Protocol):
    """A way to put a cell's data into messages; holds the state of one connection after the other. No I/O.

    ``historical`` is true for what was measured before the consumers could hear it.
    """

    @property
    def ready(self) -> bool:
        """True once anything but the birth may be sent."""
        ...

    @property
    def announced(self) -> bool:
        """True if the death is published also by the broker when we leave on purpose."""
        ...

    def connect(self) -> Message:
        """Begin a new connection; return its last will."""
        ...

    def subscriptions(self) -> Sequence[Subscription]:
        """Topics to listen to, before anything is sent."""
        ...

    def heard(self, topic: str, payload: bytes, retained: bool) -> Order | Sequence[Message]:
        """Take a message; return its consequence."""
        ...

    def birth(self, now: int) -> Sequence[Message]:
        """All that a consumer needs to know first, at ``now`` UTC ns."""
        ...

    def label(self, labels: Labels, now: int) -> Sequence[Message]:
        """Take the channels that rows have from now on."""
        ...

    def missed(self, row: Row) -> None:
        """Take a row that is not sent, or later."""
        ...

    def row(self, row: Row, historical: bool, now: int) -> Sequence[Message]:
        """A row of the frames."""
        ...

    def predicted(self, model: str, units: Mapping[str, str], row: Row, now: int) -> Sequence[Message]:
        """A row of a model's outputs."""
        ...

    def result(self, item: Result | Event, historical: bool, now: int) -> Sequence[Message]:
        """An interval, task, energy, alarm or event."""
        ...

    def archived(self, result: Archived, now: int) -> Sequence[Message]:
        """An alarm, task or energy of before this start, out of the record: nothing of it is so now."""
        ...

    def health(self, status: Mapping[str, Any], now: int) -> Sequence[Message]:
        """The cell's health."""
        ...

    def death(self, now: int) -> Sequence[Message]:
        """The last words before we leave on purpose."""
        ...


def level(name: str) -> str:
    """A name as one level of a topic: ``+ # / % $`` and control characters become ``%XX``."""
    return _UNSAFE.sub(lambda found: f"%{ord(found[0]):02X}", name)
