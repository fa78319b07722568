"""Messages recorded as JSON: ticks, events, results and health."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, get_args

import pydantic_core
from pydantic import TypeAdapter, ValidationError

from cellwatt.batch import Tick
from cellwatt.results import Alarm, Energy, Event, Interval, Prediction, Task


@dataclass(frozen=True, slots=True)
class Health:
    """The daemon's health at ``time`` (UTC ns), as it was published."""

    time: int
    status: Mapping[str, Any]


Message = Tick | Event | Interval | Task | Energy | Prediction | Alarm | Health

TOPICS: Mapping[type[Message], str] = {kind: f"/{kind.__name__.lower()}" for kind in get_args(Message)}


_ADAPTERS: Mapping[type[Message], TypeAdapter[Any]] = {kind: TypeAdapter(kind) for kind in TOPICS}


def schema(kind: type[Message]) -> bytes:
    """JSON Schema of a kind of message."""
    return json.dumps(simple(_ADAPTERS[kind].json_schema())).encode()


def simple(schema: Any) -> Any:
    """Replace ``anyOf`` of a type and null by the type in a JSON Schema: readers of MCAP do not support ``anyOf``."""
    if isinstance(schema, list):
        return [simple(part) for part in schema]
    if not isinstance(schema, dict):
        return schema
    changed = {name: simple(part) for name, part in schema.items() if name != "default"}
    options = [option for option in changed.get("anyOf", ()) if option != {"type": "null"}]
    if len(options) != 1:
        return changed
    return {name: part for name, part in changed.items() if name != "anyOf"} | options[0]


def time_of(message: Message) -> int:
    """The time under which a message is recorded, UTC ns."""
    match message:
        case Interval() | Task() | Energy():
            return message.end
        case Prediction():
            return message.time[-1] if message.time else 0
        case _:
            return message.time


def _plain(value: object) -> object:
    """Convert numpy scalars and arrays in evidence and other free-form data."""
    tolist = getattr(value, "tolist", None)
    if tolist is None:
        raise TypeError(f"{type(value).__name__} cannot be recorded")
    return tolist()


def encode(message: Message) -> bytes:
    """Encode a message as JSON; numbers that JSON lacks become the texts NaN, Infinity and -Infinity.

    Raises ``ValueError`` if free-form data hold values that JSON cannot represent.
    """
    return pydantic_core.to_json(message, inf_nan_mode="strings", fallback=_plain)


def decode(kind: type[Message], data: bytes) -> Message:
    """Decode a message from JSON; raises ``ValueError`` if it is not of that kind."""
    try:
        message: Message = _ADAPTERS[kind].validate_json(data)
    except ValidationError as error:
        raise ValueError(" ".join(str(error).split())[:200]) from error
    return message
