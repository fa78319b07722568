"""Topics as the Foxglove app knows them, and messages on their way there."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any, Final

from cellwatt.record import messages
from cellwatt.record.encoder import PACKAGE
from cellwatt.results import Alarm, Energy, Event, Interval, Prediction, Task

KINDS: Final[tuple[type[messages.Message], ...]] = (Interval, Task, Energy, Prediction, Alarm, Event, messages.Health)
"""Results and more that are told as JSON, as in recordings."""
LOG: Final = "/log"
TRANSFORMS: Final = "/tf"
SCENE: Final = "/scene"
CHANNELS: Final = "/channels"
_CHANNELS_SCHEMA: Final = {
    "type": "object",
    "description": "Names and SI units behind the fields of /frame.",
    "properties": {
        "channels": {
            "type": "array",
            "items": {
                "type": "object",
                "properties": {name: {"type": "string"} for name in ("field", "channel", "unit")},
            },
        }
    },
}


@dataclass(frozen=True, slots=True)
class Topic:
    """A topic with the schema of its messages; ``encoding`` is ``json`` or ``protobuf``."""

    name: str
    encoding: str
    schema_name: str
    schema: bytes
    metadata: Mapping[str, str] = field(default_factory=dict, compare=False, hash=False)

    @property
    def schema_encoding(self) -> str:
        """Name of the schema's own language."""
        return "jsonschema" if self.encoding == "json" else self.encoding


@dataclass(frozen=True, slots=True)
class Outgoing:
    """A message for a topic at ``time``, UTC ns.

    With a ``key`` it is also for those who come later, until another with that key, or one that is ``over``.
    """

    topic: Topic
    time: int
    data: bytes
    key: str | None = None
    over: bool = False


@dataclass(frozen=True, slots=True)
class Moment:
    """Messages of one instant, ``after`` s behind those before them; UTC ns."""

    time: int
    messages: tuple[Outgoing, ...]
    after: float = 0.0


def json_topic(kind: type[messages.Message]) -> Topic:
    """The topic of a kind of results, events or health."""
    return _json_topics()[messages.TOPICS[kind]]


@cache
def _json_topics() -> dict[str, Topic]:
    made = {}
    for kind in KINDS:
        schema = messages.schema(kind)
        made[messages.TOPICS[kind]] = Topic(messages.TOPICS[kind], "json", f"{PACKAGE}.{kind.__name__}", schema)
    return made


@cache
def channels_topic() -> Topic:
    """The topic that says which channel and unit is behind each field of the frames."""
    return Topic(CHANNELS, "json", f"{PACKAGE}.Channels", json.dumps(_CHANNELS_SCHEMA).encode())


@cache
def own() -> Any:
    """Foxglove's own types; the library is loaded when they are first needed."""
    from foxglove import messages as found

    return found


def stamp_of(time: int) -> Any:
    """A time in UTC ns as the app's own type."""
    return own().Timestamp(*divmod(time, 1_000_000_000))


def drawn_topic(name: str, kind: str) -> Topic:
    """A topic of one of Foxglove's own types, such as ``Log``."""
    schema = getattr(own(), kind).get_schema()
    return Topic(name, schema.encoding, schema.name, schema.data)
