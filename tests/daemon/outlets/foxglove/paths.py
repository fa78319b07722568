"""Message paths of the Foxglove app: ``/topic{field=="value"}.field[-1]``."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

_STEP = re.compile(r'\{(\w+)=="([^"]*)"\}|\.(\w+)|\[(-?\d+)\]')


def found(messages: Mapping[str, list[Any]], path: str) -> list[Any]:
    """The values at a path in decoded messages by topic; ``KeyError`` for a topic that there is not."""
    topic = re.match(r"/[\w/]+", path)
    assert topic is not None
    out = list(messages[topic[0]])
    rest = path[topic.end() :]
    while rest:
        step = _STEP.match(rest)
        assert step is not None, rest
        out = [value for message in out for value in _of(message, *step.groups())]
        rest = rest[step.end() :]
    return out


def _of(message: Any, tested: str | None, wanted: str, name: str | None, index: str | None) -> list[Any]:
    if tested is not None:
        return [message] if _field(message, tested) == wanted else []
    if name is not None:
        return [_field(message, name)]
    assert index is not None
    return [message[int(index)]]


def _field(message: Any, name: str) -> Any:
    return message[name] if isinstance(message, dict) else getattr(message, name)
