"""Messages as JSON lines, and what a live cell takes of them."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import asdict, is_dataclass
from math import isfinite
from typing import Any

import numpy as np

from cellwatt.alarms import Standing
from cellwatt.batch import Batch
from cellwatt.frames import Frames
from cellwatt.live.state import LiveCell
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


def take_line(cell: LiveCell, line: Mapping[str, Any]) -> list[Standing]:
    """Let a live cell take a line, of frames the power; give the alarms of which it says something."""
    content = line["content"]
    if line["kind"] != "frame":
        return cell.add(line["kind"], content)
    if power := content.get("power"):
        values = np.array(list(power.values()), dtype=float).T
        cell.frames.add(np.array(content["time"], np.int64), tuple(power), ("W",) * len(power), values)
    return []


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
