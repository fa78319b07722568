"""Results, events and health as JSON. Pure.

A message is the flat object of the dataclass in ``cellwatt.results`` plus its ``mark``, for consumers that cannot
read attachments. A number that is not finite becomes ``null``.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields
from functools import cache
from typing import Any, Final

import numpy as np
import pydantic_core
from pydantic import TypeAdapter, ValidationError

from cellwatt.errors import ProtocolError
from cellwatt.outlets.zenoh.keys import ALARM, EVENT, topic_of_series
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.results import Alarm, Energy, Event, Interval, Prediction, Result, Task, series_of

TYPES: Final[Mapping[str, type[Result | Event]]] = {
    "interval": Interval,
    "task": Task,
    "energy": Energy,
    "prediction": Prediction,
    ALARM: Alarm,
    EVENT: Event,
}
"""Type of the messages of each kind of topic."""

LONGEST_REASON: Final = 500
"""Most characters of the reason why a message is invalid; the reason may quote the message."""
_FLOATS: Final = {
    kind: {f.name for f in fields(content) if "float" in str(f.type) and "None" not in str(f.type)}
    for kind, content in TYPES.items()
}
"""Float fields that are never ``None``, by kind of topic."""


def topic_of(item: Result | Event) -> str:
    """The topic in whose numbering an item is."""
    return topic_of_series(series_of(item))


def encode_item(item: Result | Event, mark: Mark) -> bytes:
    """Encode a result or event as JSON."""
    body = {f.name: getattr(item, f.name) for f in fields(item)}
    return encode_json({"mark": _told(mark), **body})


def encode_json(value: Any) -> bytes:
    """Encode JSON-like data, including numpy values and paths; non-finite numbers become ``null``."""
    return pydantic_core.to_json(value, inf_nan_mode="null", fallback=_plain)


def decode_item(kind: str, payload: bytes) -> Result | Event:
    """Decode a JSON message of a kind of topic into a result or event. Raises ``ProtocolError``."""
    try:
        body = parse_json(payload)
    except ValueError as error:
        raise ProtocolError(f"a message of {kind} is not JSON: {error}") from error
    return from_json(kind, body)


def parse_json(payload: bytes) -> Any:
    """Parse JSON. Raises ``ValueError`` also if it is nested too deeply."""
    return pydantic_core.from_json(payload)


def from_json(kind: str, body: dict[str, Any]) -> Result | Event:
    """Build a result or event from parsed JSON. Raises ``ProtocolError``."""
    try:
        found: Result | Event = adapter(kind).validate_python(
            body | {name: _with_nan(body[name]) for name in _FLOATS[kind] & body.keys()}
        )
        return found
    except (ValidationError, KeyError, TypeError, AttributeError) as error:
        reason = " ".join(str(error).split())[:LONGEST_REASON]
        raise ProtocolError(f"a message of {kind} is not what its schema says: {reason}") from error


def health(mark: Mark, session: int, positions: Mapping[str, tuple[int, int]], status: Mapping[str, Any]) -> bytes:
    """Encode the health message of a daemon session; its time is the mark's."""
    body = {"session": session, "time": mark.arrival, "positions": positions, "status": status}
    return encode_json({"mark": _told(mark), **body})


def _told(mark: Mark) -> dict[str, int]:
    return {"session": mark.session, "sequence": mark.sequence}


@cache
def adapter(kind: str) -> TypeAdapter[Any]:
    """The pydantic adapter that validates the messages of a kind of topic."""
    return TypeAdapter(TYPES[kind])


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    return value.tolist() if isinstance(value, np.ndarray) else str(value)


def _with_nan(value: Any) -> Any:
    """JSON numbers, single or in lists and objects, with NaN in place of ``null``."""
    match value:
        case None:
            return math.nan
        case list():
            return [_with_nan(v) for v in value]
        case dict():
            return {name: _with_nan(v) for name, v in value.items()}
    return value
