"""Results, events and health as JSON. Pure.

A message is the flat object of the dataclass in ``cellwatt.results`` and its ``mark``, for consumers that cannot
see attachments. A number that is not finite is ``null``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import fields
from functools import cache
from typing import Any, Final

import numpy as np
import pydantic_core
from pydantic import TypeAdapter, ValidationError

from cellwatt.errors import ProtocolError
from cellwatt.publish.keys import ALARM, EVENT, prediction_topic
from cellwatt.publish.mark import Mark
from cellwatt.results import Alarm, Energy, Event, Interval, Prediction, Result, Task

TYPES: Final[Mapping[str, type[Result | Event]]] = {
    "interval": Interval,
    "task": Task,
    "energy": Energy,
    "prediction": Prediction,
    ALARM: Alarm,
    EVENT: Event,
}
"""What the messages of a kind of topic hold."""

LONGEST_REASON: Final = 300
"""Characters of what is wrong with a message; it may repeat what was in it."""
_NUMBERS: Final = ("speed", "total", "uncertainty", "positive_mechanical", "motion_efficiency_percent")
_NUMBER_LISTS: Final = ("displacement", "pose", "peak_speed")


def topic_of(item: Result | Event) -> str:
    """The topic that numbers it."""
    if isinstance(item, Prediction):
        return prediction_topic(item.model)
    return next(topic for topic, kind in TYPES.items() if isinstance(item, kind))


def encode_item(item: Result | Event, mark: Mark) -> bytes:
    """A result or event as JSON."""
    body = {f.name: getattr(item, f.name) for f in fields(item)}
    return encode_json({"mark": _told(mark), **body})


def encode_json(value: Any) -> bytes:
    """Anything JSON-like, numpy's numbers and paths included; what is not finite becomes ``null``."""
    return pydantic_core.to_json(value, inf_nan_mode="null", fallback=_plain)


def decode_item(kind: str, payload: bytes) -> Result | Event:
    """The result or event in a message of a kind of topic. Raises ``ProtocolError`` where it is none."""
    try:
        body = parse_json(payload)
    except ValueError as error:
        raise ProtocolError(f"a message of {kind} is not JSON: {error}") from error
    return from_json(kind, body)


def parse_json(payload: bytes) -> Any:
    """JSON as it came; raises ``ValueError`` where it is none, also where it is nested beyond all sense."""
    return pydantic_core.from_json(payload)


def from_json(kind: str, body: dict[str, Any]) -> Result | Event:
    """The same from JSON that is already parsed. Raises ``ProtocolError`` where it is none."""
    try:
        found: Result | Event = adapter(kind).validate_python(_with_nan(body))
        return found
    except (ValidationError, KeyError, TypeError, AttributeError) as error:
        reason = " ".join(str(error).split())[:LONGEST_REASON]
        raise ProtocolError(f"a message of {kind} is not what its schema says: {reason}") from error


def health(mark: Mark, session: int, positions: Mapping[str, tuple[int, int]], status: Mapping[str, Any]) -> bytes:
    """The health message of a session of the daemon, said at the mark's time."""
    body = {"session": session, "time": mark.arrival, "positions": positions, "status": status}
    return encode_json({"mark": _told(mark), **body})


def _told(mark: Mark) -> dict[str, int]:
    return {"session": mark.session, "sequence": mark.sequence}


@cache
def adapter(kind: str) -> TypeAdapter[Any]:
    """What checks the messages of a kind of topic."""
    return TypeAdapter(TYPES[kind])


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    return value.tolist() if isinstance(value, np.ndarray) else str(value)


def _with_nan(body: dict[str, Any]) -> dict[str, Any]:
    changed: dict[str, Any] = {name: math.nan for name in _NUMBERS if body.get(name, 0.0) is None}
    changed |= {name: _numbers(body[name]) for name in _NUMBER_LISTS if name in body}
    if "outputs" in body:
        changed["outputs"] = {name: _numbers(values) for name, values in body["outputs"].items()}
    for name in ("groups", "group_uncertainty"):
        if name in body:
            changed[name] = dict(zip(body[name], _numbers(body[name].values()), strict=True))
    return body | changed


def _numbers(values: Iterable[float | None]) -> tuple[float, ...]:
    return tuple(math.nan if value is None else value for value in values)
