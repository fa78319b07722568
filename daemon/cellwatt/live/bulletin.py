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
        content = message.content
        return self.of_line(line_of(message), content.session if isinstance(content, Health) else None)

    def of_line(self, line: Mapping[str, Any], session: int | None = None) -> Iterator[str]:
        """Lines about a message in the form that ``watch --json`` prints; ``session``: see ``LiveCell.add``."""
        if self._silent:
            self._silent = False
            yield _line("receiving messages again")
        before, restarts = self.cell.status, self.cell.restarts
        alarms = self.cell.add(line["kind"], line["content"], session)
        if self.cell.restarts > restarts:
            before = {}
            yield _line("the daemon was restarted")
        kind, content = line["kind"], line["content"]
        if kind == "health":
            yield from _changes(before, self.cell.status)
        elif kind == "gap":
            yield _line(f"{content['count']} of {line['topic']} are lost: {content['reason']}")
        elif text := _text_of(kind, content):
            yield _line(text, content["time" if kind == "event" else "end"])
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


def _text_of(kind: str, content: Mapping[str, Any]) -> str:
    """Text for a result or an event; ``""`` for kinds that are not printed."""
    match kind:
        case "interval" if content["closed"]:
            joints = (
                f"joint{'s' * (len(content['moving']) > 1)} {'+'.join(map(str, content['moving']))} moved"
                if content["moving"]
                else "rest"
            )
            return f"interval {content['number']}: {joints}, {_seconds(content)}"
        case "task":
            name = f"{content['name']} × {content['repetition']}"
            return f"task {name} ({content['variant']}), {_seconds(content)}"
        case "energy":
            name = f"{content['task']} × {content['repetition']}"
            return f"energy {name}: {content['total']:.0f} J ± {content['uncertainty']:.1f} J"
        case "event":
            return f"{content['source'] or 'cell'}: {content['text']}"
    return ""


def _standing(cell: LiveCell) -> str:
    status = cell.status
    figures = summary(f"{status['site']}/{status['cell']}", status)
    return f"{stands({**figures, 'state': cell.state})}, {alarm_count(len(cell.alarms.up))}"


def _seconds(span: Mapping[str, Any]) -> str:
    return f"{(span['end'] - span['start']) * 1e-9:.2f} s"


def _line(text: str, ns: int | None = None) -> str:
    return f"{_at(time.time_ns() if ns is None else ns)} {text}"


def _at(ns: int) -> str:
    return datetime.fromtimestamp(ns * 1e-9, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
