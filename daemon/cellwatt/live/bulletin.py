"""A live cell as plain lines, for a log: what changed, and now and then how it stands."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from typing import Any, Final

from cellwatt.live.state import LiveCell
from cellwatt.results import Alarm, Energy, Event, Interval, Task
from cellwatt.subscriber import Gap, Health, Message

EVERY: Final = 10.0
"""s between two lines of how the cell stands."""


class Bulletin:
    """Lines about what the messages of a cell change; ``now`` is monotonic."""

    def __init__(self) -> None:
        self.cell = LiveCell()
        self._silent = False
        self._stands_at = 0.0

    def of(self, message: Message) -> Iterator[str]:
        """Lines about a message."""
        if self._silent:
            self._silent = False
            yield _line("messages again")
        before, alarms, restarts = self.cell.status, dict(self.cell.alarms), self.cell.restarts
        self.cell.take(message)
        if self.cell.restarts > restarts:
            before = {}
            yield _line("the daemon was started again")
        match message.content:
            case Health():
                yield from _changes(before, self.cell.status)
            case Gap() as gap:
                yield _line(f"{gap.count} of {message.topic} are lost: {gap.reason}")
            case Interval() | Task() | Energy() | Event() as content:
                if said := _said(content):
                    yield _line(said, content.time if isinstance(content, Event) else content.end)
            case Alarm() as alarm if _news(alarm, alarms.get(alarm.id)):
                yield _line(f"{alarm.severity if alarm.active else 'cleared'}: {alarm.statement}", alarm.time)

    def stands(self, now: float) -> Iterator[str]:
        """Lines that are due: the silence of the cell, or each ``EVERY`` s how it stands."""
        cell = self.cell
        if (gone := cell.silent_for(now)) is not None:
            if not self._silent:
                self._silent = True
                yield _line(f"no message for {gone:.0f} s; last at {_at(cell.heard_at)}")
        elif cell.status and now >= self._stands_at:
            self._stands_at = now + EVERY
            yield _line(_standing(cell))


def _news(alarm: Alarm, before: Mapping[str, Any] | None) -> bool:
    """True unless an alarm only tells other figures than before."""
    return not (before and alarm.active and (alarm.severity, alarm.joint) == (before["severity"], before["joint"]))


def _changes(before: Mapping[str, Any], status: Mapping[str, Any]) -> Iterator[str]:
    known = before.get("sources", {})
    for name, source in status["sources"].items():
        was, state = known.get(name, {}).get("state"), source["state"]
        if was != state:
            why = f": {source['error']}" if source["error"] else ""
            yield _line(f"source {name}: {f'{was}, now ' if was else ''}{state}{why}", status["time"])
    for name in known.keys() - status["sources"].keys():
        yield _line(f"source {name}: gone from the settings", status["time"])
    for warning in status.get("warnings", ()):
        if warning not in before.get("warnings", ()):
            yield _line(f"warning: {warning}", status["time"])


def _said(content: Interval | Task | Energy | Event) -> str:
    match content:
        case Interval():
            joints = (
                f"joint{'s' * (len(content.moving) > 1)} {'+'.join(map(str, content.moving))} moved"
                if content.moving
                else "rest"
            )
            return f"interval {content.number}: {joints}, {_seconds(content)}" if content.closed else ""
        case Task():
            return f"task {content.name} × {content.repetition} ({content.variant}), {_seconds(content)}"
        case Energy():
            return f"energy {content.task} × {content.repetition}: {content.total:.0f} J ± {content.uncertainty:.1f} J"
        case Event():
            return f"{content.source or 'cell'}: {content.text}"


def _standing(cell: LiveCell) -> str:
    status = cell.status
    sources = status["sources"].values()
    lost = sum(sum(s["missed"].values()) + sum(s["dropped"].values()) for s in sources)
    well = sum(s["state"] == "ok" for s in sources)
    alarms = f"{len(cell.alarms)} alarm{'s' * (len(cell.alarms) != 1)}" if cell.alarms else "no alarm"
    return (
        f"{status['site']}/{status['cell']} is {status['state']}: {well} of {len(sources)} sources ok, "
        f"{sum(s['received'] for s in sources)} samples received, {lost} lost, {alarms}"
    )


def _seconds(span: Interval | Task) -> str:
    return f"{(span.end - span.start) * 1e-9:.2f} s"


def _line(text: str, ns: int | None = None) -> str:
    return f"{_at(time.time_ns() if ns is None else ns)} {text}"


def _at(ns: int) -> str:
    return datetime.fromtimestamp(ns * 1e-9, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
