"""Topics of the Foxglove app, and messages to be sent on them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Final

from cellwatt.record import messages
from cellwatt.record.encoder import PACKAGE
from cellwatt.results import Alarm, Energy, Event, Interval, Prediction, Task

KINDS: Final[tuple[type[messages.Message], ...]] = (Interval, Task, Energy, Prediction, Alarm, Event, messages.Health)
"""Results, events and health, sent as JSON as in recordings."""
LOG: Final = "/log"


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic with the schema of its messages; ``encoding`` is ``json`` or ``protobuf``."""

    name: str
    encoding: str
    schema_name: str
    schema: bytes

    @property
    def schema_encoding(self) -> str:
        """Name of the schema language."""
        return "jsonschema" if self.encoding == "json" else self.encoding


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A message for a topic at ``time``, UTC ns.

    With a ``key`` it is also sent to clients that subscribe later, until another message with that key replaces it or
    one that is ``over`` ends it.
    """

    topic: Topic
    time: int
    data: bytes
    key: str | None = None
    over: bool = False


@dataclass(frozen=True, slots=True)
class Moment:
    """Messages of one ``time``, UTC ns, ``after`` s later than the moment before."""

    time: int
    messages: tuple[Outgoing, ...]
    after: float = 0.0


JSON_TOPICS: Final = {
    kind: Topic(messages.TOPICS[kind], "json", f"{PACKAGE}.{kind.__name__}", messages.schema(kind)) for kind in KINDS
}


@cache
def own() -> Any:
    """Foxglove's message types; the library is loaded on first use."""
    from foxglove import messages as found

    return found


def log_topic() -> Topic:
    """The topic of the log, with Foxglove's own type of messages."""
    schema = own().Log.get_schema()
    return Topic(LOG, schema.encoding, schema.name, schema.data)
