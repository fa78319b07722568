"""A live cell as lines of text: each message as JSON; or each change, and the state at regular times, as plain text."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from dataclasses import asdict
from datetime import UTC, datetime
from math import isfinite
from typing import Any, Final

from cellwatt.batch import Batch
from cellwatt.frames import Frames
from cellwatt.live.site import alarm_count, stands, summary
from cellwatt.live.state import LiveCell
from cellwatt.outlets.zenoh.messages import from_json
from cellwatt.results import Energy, Event, Interval, Result, Task
from cellwatt.subscriber import Gap, Health, Message

EVERY: Final = 10.0
"""Interval, s, between two lines with the state of the cell."""


def line_of(message: Message) -> dict[str, Any]:
    """Message as an object ready for JSON, with the time of receipt, UTC ns.

    Blocks of samples are reduced to count and time span; frames also keep their measured power, for comparison with
    predictions.
    """
    kind, content = message.topic.split("/", 1)[0], message.content
    body: dict[str, Any]
    if isinstance(content, Batch | Frames):
        body = {"count": len(content), "start": int(content.time[0]), "end": int(content.time[-1])}
        body |= _power(content) if isinstance(content, Frames) else {}
    elif isinstance(content, Health):
        body = dict(content.status)
    else:
        body = asdict(content)
    return {
        "kind": "gap" if isinstance(content, Gap) else kind,
        "topic": message.topic,
        "session": message.session,
        "sequence": message.sequence,
        "backfilled": message.backfilled,
        "received": time.time_ns(),
        "content": body,
    }


def message_of(line: Mapping[str, Any]) -> Message:
    """The message of a line of ``line_of`` that is not about a block. Raises ``ProtocolError``."""
    kind, body = line["kind"], line["content"]
    content: Health | Gap | Result | Event
    if kind == "health":
        content = Health(line["session"], body["time"], {}, body)
    else:
        content = Gap(**body) if kind == "gap" else from_json(kind, body)
    return Message(line["topic"], line["session"], line["sequence"], line["backfilled"], content)


def _power(frames: Frames) -> dict[str, Any]:
    """Power in frames: ``time``, ns, and ``power``, W by channel, ``None`` if missing; empty without power channels."""
    power = {
        channel.name: [value if isfinite(value) else None for value in values.tolist()]
        for channel, values in zip(frames.layout.channels, frames.values.T, strict=True)
        if channel.unit == "W"
    }
    return {"time": frames.time.tolist(), "power": power} if power else {}


class Bulletin:
    """Lines about changes in the messages of a cell; ``now`` is monotonic time, s."""

    def __init__(self) -> None:
        self.cell = LiveCell()
        self._silent = False
        self._stands_at = 0.0

    def of(self, message: Message) -> Iterator[str]:
        """Lines about a message received by a subscriber."""
        if self._silent:
            self._silent = False
            yield _line("receiving messages again")
        content = message.content
        if isinstance(content, Health):
            before, restarts = self.cell.status, self.cell.restarts
            alarms = self.cell.add_health(content.status, content.session)
            if self.cell.restarts > restarts:
                before = {}
                yield _line("the daemon was restarted")
            yield from _changes(before, self.cell.status)
        else:
            alarms = self.cell.add(content)
            if isinstance(content, Gap):
                yield _line(f"{content.count} of {message.topic} are lost: {content.reason}")
            else:
                yield from _told(content)
        for standing in alarms:
            if standing.news:
                word = standing.alarm.severity if standing.raised else "cleared"
                yield _line(f"{word}: {standing.message.statement}", standing.message.time)

    def stands(self, now: float) -> Iterator[str]:
        """Lines due at ``now``: that the cell is silent, or every ``EVERY`` s the state of the cell."""
        cell = self.cell
        if (gone := cell.silent_for(now)) is not None:
            if not self._silent:
                self._silent = True
                yield _line(f"no message for {gone:.0f} s; last at {_at(cell.heard_at)}")
        elif cell.status and now >= self._stands_at:
            self._stands_at = now + EVERY
            yield _line(_standing(cell))


def _changes(before: Mapping[str, Any], status: Mapping[str, Any]) -> Iterator[str]:
    """Lines about changes between two health messages; empty: none received, or one of another version."""
    known, sources = before.get("sources", {}), status.get("sources", {})
    for name, source in sources.items():
        was, state = known.get(name, {}).get("state"), source["state"]
        if was != state:
            why = f": {source['error']}" if source["error"] else ""
            yield _line(f"source {name}: {f'{was}, now ' if was else ''}{state}{why}", status["time"])
    for name in known.keys() - sources.keys():
        yield _line(f"source {name}: removed from the settings", status["time"])
    for warning in status.get("warnings", ()):
        if warning not in before.get("warnings", ()):
            yield _line(f"warning: {warning}", status["time"])


def _told(content: Batch | Frames | Result | Event) -> Iterator[str]:
    """The line about a result or an event, if its kind is printed."""
    match content:
        case Interval(closed=True, moving=moving):
            moved = f"joint{'s' * (len(moving) > 1)} {'+'.join(map(str, moving))} moved" if moving else "rest"
            yield _line(f"interval {content.number}: {moved}, {_seconds(content)}", content.end)
        case Task(name=name, repetition=repetition):
            yield _line(f"task {name} × {repetition} ({content.variant}), {_seconds(content)}", content.end)
        case Energy(task=name, repetition=repetition):
            figures = f"{content.total:.0f} J ± {content.uncertainty:.1f} J"
            yield _line(f"energy {name} × {repetition}: {figures}", content.end)
        case Event():
            yield _line(f"{content.source or 'cell'}: {content.text}", content.time)


def _standing(cell: LiveCell) -> str:
    status = cell.status
    figures = summary(f"{status['site']}/{status['cell']}", status)
    return f"{stands({**figures, 'state': cell.state})}, {alarm_count(len(cell.alarms.up))}"


def _seconds(span: Interval | Task) -> str:
    return f"{(span.end - span.start) * 1e-9:.2f} s"


def _line(text: str, ns: int | None = None) -> str:
    return f"{_at(time.time_ns() if ns is None else ns)} {text}"


def _at(ns: int) -> str:
    return datetime.fromtimestamp(ns * 1e-9, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
