"""Messages as JSON lines."""

from __future__ import annotations

import time
from dataclasses import asdict, is_dataclass
from math import isfinite
from typing import Any

from cellwatt.batch import Batch
from cellwatt.frames import Frames
from cellwatt.subscriber import Gap, Health, Message


def line_of(message: Message) -> dict[str, Any]:
    """Message as a JSON-ready object, with the time of receipt, UTC ns.

    Blocks are summarised as count and time span; measured power in frames is kept, to be compared with predictions.
    """
    kind, body = _kind_and_body(message)
    return {
        "kind": kind,
        "topic": message.topic,
        "session": message.session,
        "sequence": message.sequence,
        "backfilled": message.backfilled,
        "received": time.time_ns(),
        "content": body,
    }


def _kind_and_body(message: Message) -> tuple[str, dict[str, Any]]:
    kind = message.topic.split("/", 1)[0]
    content = message.content
    if isinstance(content, Batch | Frames):
        block = {"count": len(content), "start": int(content.time[0]), "end": int(content.time[-1])}
        return kind, block | (_power(content) if isinstance(content, Frames) else {})
    if isinstance(content, Health):
        return kind, dict(content.status)
    if isinstance(content, Gap):
        return "gap", asdict(content)
    assert is_dataclass(content) and not isinstance(content, type)
    return kind, asdict(content)


def _power(frames: Frames) -> dict[str, Any]:
    """Power in frames: ``time`` ns and ``power`` W by channel, ``None`` where missing; empty without power channels."""
    power = {
        channel.name: [value if isfinite(value) else None for value in values.tolist()]
        for channel, values in zip(frames.layout.channels, frames.values.T, strict=True)
        if channel.unit == "W"
    }
    return {"time": frames.time.tolist(), "power": power} if power else {}
