"""The page of ``cellwatt plot``: channels, alarms and tasks of a recording."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

import numpy as np

from cellwatt.errors import ConfigError, RecordingError
from cellwatt.frames import Frames, cut
from cellwatt.record import Recording
from cellwatt.registry import stage as find_stage
from cellwatt.report import Axis, Figure, Notes, Panel, Provenance, Report, Section, Table, over_time
from cellwatt.report.drawing import MOST_POINTS, curve, note, stretch, thin, upright
from cellwatt.report.figure import Json
from cellwatt.report.numbers import unit
from cellwatt.report.theme import BAD, GOOD, SERIES
from cellwatt.results import Alarm, Interval, Task
from cellwatt.stage import CellInfo
from cellwatt.units import Units

LEAD = (
    "Coloured bands: intervals, labelled with the joints that move. "
    "Dotted lines: alarms raised (red) and cleared (green)."
)


def report(recording: Recording, start: float | None, end: float | None, wanted: Sequence[str], units: Units) -> Report:
    """Make the page. Raises ``RecordingError`` if there is nothing to draw.

    ``start`` and ``end`` s from the recording's start; ``wanted``: parts of channel names, empty for all; values are
    shown in ``units``.
    """
    frames = recording.frames_table()
    origin = int(frames.time[0])
    low, high = -np.inf if start is None else start - 1e-9, np.inf if end is None else end + 1e-9
    seconds = (frames.time - origin) * 1e-9
    first, last = np.searchsorted(seconds, low), np.searchsorted(seconds, high, side="right")
    figure = channels_over_time(recording, frames, int(first), int(last), wanted, units)
    raised = [a for a in _without_updates(recording.alarms()) if a.active]
    table = [[f"{(a.time - origin) * 1e-9:.2f} s", a.severity, a.statement] for a in raised]
    tasks = recording.tasks()
    header = recording.header
    return Report(
        name=f"{header.site}/{header.cell}",
        subject="recording",
        facts=_facts(recording, frames),
        verdict=f"{len(raised)} alarm{'s were' if len(raised) > 1 else ' was'} raised." if raised else "No alarms.",
        tone="open" if recording.damage else "part" if raised else "good",
        sections=[
            Section("Channels over time", [figure], LEAD),
            Section("Alarms", [Table("Alarms", ("at", "severity", "alarm"), table)] if table else []),
            Section("Tasks", [Notes(_tasks(tasks))]),
            Section("Damage to the recording", [Notes([str(d) for d in recording.damage])]),
        ],
        provenance=Provenance.here(),
    )


def channels_over_time(
    recording: Recording,
    frames: Frames,
    first: int,
    last: int,
    wanted: Sequence[str],
    units: Units,
    *,
    since: tuple[int, str] | None = None,
    most: int = MOST_POINTS * 2,
) -> Figure:
    """Draw frames ``first`` to before ``last`` of a recording by quantity, with its intervals and alarms marked.

    ``since`` is the zero of the time axis, UTC ns, and its name; by default the first frame. Raises
    ``RecordingError`` if there is nothing to draw.
    """
    groups = _groups(frames, wanted, units)
    if not groups or first >= last:
        raise RecordingError("nothing to draw: no such channels, or no frames in that span")
    origin, name = since or (int(frames.time[0]), "the start")
    shown = (float(frames.time[first] - origin) * 1e-9, float(frames.time[last - 1] - origin) * 1e-9)
    intervals = recording.intervals() or _segment(frames)
    marks, labels = _bands(intervals, origin, shown)
    marks += _lines(_without_updates(recording.alarms()), origin, shown)
    x = Axis(f"s since {name}", shown)
    drawn = cut(frames, first, last)
    rows = [
        [Panel(_curves(drawn, columns, units, shown[0], most), x, marks=marks + labels * (row == 0), title=title)]
        for row, (title, columns) in enumerate(groups)
    ]
    return over_time(f"Channels of {recording.header.cell} over time", rows)


def _facts(recording: Recording, frames: Frames) -> list[str]:
    start = datetime.fromtimestamp(recording.start * 1e-9, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    length = (recording.end - recording.start) * 1e-9
    return [start, f"{length:.1f} s", f"{len(frames)} frames at {frames.layout.rate:g} Hz"]


def _tasks(tasks: Sequence[Task]) -> list[str]:
    out = []
    for name in sorted({t.name for t in tasks}):
        mine = [t for t in tasks if t.name == name]
        variants = ", ".join(sorted({t.variant for t in mine}))
        out.append(f"{name}: {len(mine)} repetitions ({variants})")
    return out


def _groups(frames: Frames, wanted: Sequence[str], units: Units) -> list[tuple[str, list[int]]]:
    """Titles and columns of the diagrams: channels of one source, one last part of the name and one unit."""
    groups: dict[str, list[int]] = {}
    for i, channel in enumerate(frames.layout.channels):
        if wanted and not any(w in channel.name for w in wanted):
            continue
        if channel.kind == "discrete" and not wanted:
            continue
        quantity = channel.short.rsplit(".", 1)[-1]
        groups.setdefault(f"{channel.source} · {quantity} [{unit(units.of(channel.unit).name)}]", []).append(i)
    return list(groups.items())


def _curves(frames: Frames, columns: Sequence[int], units: Units, start: float, most: int) -> list[Json]:
    """Curves of columns, in ``units`` and thinned to ``most`` points, with gaps where frames are missing."""
    step = frames.layout.step
    rows = (frames.time - frames.time[0] + step // 2) // step
    count = int(rows[-1]) + 1
    span = 1 if count <= most else -(-count // (most // 2))
    # Only spans with frames are filled and thinned: a month may lie between two sessions.
    filled, place = np.unique(rows // span, return_inverse=True)
    points = min(span, 2)
    apart, curves = step * 1e-9 * span / points, []
    for n, column in enumerate(columns):
        channel, grid = frames.layout.channels[column], np.full((len(filled), span), np.nan)
        grid[place, rows % span] = units.of(channel.unit).of(frames.values[:, column])
        thinned = np.full((-(-count // span), points), np.nan)
        thinned[filled] = thin(grid.ravel(), points * len(filled))[0].reshape(-1, points)
        colour, y = SERIES[n % len(SERIES)], thinned.ravel()
        curves.append(curve(channel.short, y, colour, start=start, step=apart, most=len(y)))
    return curves


def _segment(frames: Frames) -> list[Interval]:
    """Find intervals in the frames, if these have joints."""
    found = find_stage("segment")
    try:
        stage = found("segment", found.Settings(), frames.layout, CellInfo("", "", None, Path()))
    except ConfigError:
        return []
    results = [*stage.process(frames, ()), *stage.close()]
    return [r for r in results if isinstance(r, Interval) and r.closed]


def _bands(intervals: Sequence[Interval], origin: int, span: tuple[float, float]) -> tuple[list[Json], list[Json]]:
    """Marks and labels of the intervals in which joints move."""
    sets = sorted({i.moving for i in intervals if i.moving})
    bands, labels = [], []
    for interval in intervals:
        left, right = (interval.start - origin) * 1e-9, (interval.end - origin) * 1e-9
        if not interval.moving or right < span[0] or left > span[1]:
            continue
        colour = SERIES[sets.index(interval.moving) % len(SERIES)]
        bands.append(stretch(left, right, colour))
        labels.append(note("+".join(map(str, interval.moving)), (left + right) / 2, 0.93, colour))
    return bands, labels


def _without_updates(alarms: Sequence[Alarm]) -> list[Alarm]:
    """The raise and the clear of each alarm, without updates."""
    first = {(a.id, a.since): a for a in reversed(alarms) if a.active}
    return [a for a in alarms if not a.active or first[a.id, a.since] is a]


def _lines(alarms: Sequence[Alarm], origin: int, span: tuple[float, float]) -> list[Json]:
    """Vertical lines where alarms were raised (red) and cleared (green)."""
    shown = [(a, (a.time - origin) * 1e-9) for a in alarms if a.severity != "info"]
    return [upright(at, BAD if a.active else GOOD) for a, at in shown if span[0] <= at <= span[1]]
