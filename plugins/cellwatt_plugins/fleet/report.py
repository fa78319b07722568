"""The fleet's page: the table first, then courses of what was found, all cells by week, and what kinds share."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.report import Axis, Block, Figure, Folded, Notes, Panel, Report, Section, Table, Tile
from cellwatt.report.drawing import cells as shaded
from cellwatt.report.drawing import colours, dots, line, ribbon, upright
from cellwatt.report.numbers import fixed
from cellwatt.report.theme import BAD, MEASURED, MODEL
from cellwatt_plugins.fleet.findings import Finding, Fleet, Weekly

Float = NDArray[np.float64]

IN_A_ROW: Final = 3
"""Panels of courses."""
MOST_PANELS: Final = 24
HEIGHT: Final = 150
"""Pixels of a panel."""
CELL_HEIGHT: Final = 15
"""Pixels of a row of all cells."""
DARKEST: Final = 25.0
"""Per cent at which a week is darkest."""
FIRST: Final = 5
"""Weeks that a joint's later ones are held against."""


def report_of(found: Fleet, name: str) -> Report:
    """Return the page of a fleet; ``name`` is that of the lake."""
    worn = [f for f in found.findings if f.what == "wears"]
    other = [f for f in found.findings if f.what != "wears"]
    smallest = "; ".join(f"{kind} {value:.0f} %" for kind, value in found.smallest.items())
    return Report(
        name=name,
        subject="fleet",
        facts=[f"{len(found.cells)} cells", f"weeks of {found.first} to {found.last}"],
        verdict=found.headline,
        tone="found" if found.findings else "good",
        tiles=[
            Tile("joints that wear", str(len(worn)), "", "bad" if worn else "good"),
            Tile("other changes", str(len(other)), "of friction or energy"),
            Tile("recordings skipped", str(len(found.skipped)), "named below"),
        ],
        tiles_remark=(
            f"One false finding in the whole page has a chance of {100 * found.chance_of_false:g} %; "
            f"{found.tests} courses were tested. Changes below {found.least_percent:g} % are not told. Half the joints "
            f"would show a rise over all weeks of: {smallest or 'not known'}."
        ),
        sections=[
            Section("What changed", [_table(found.findings)] if found.findings else [], INTERVALS),
            Section("Courses of what was found", _courses(found), COURSES),
            Section("All cells by week", _all(found), HEAT),
            Section("What was left out, and what to know", _left(found)),
        ],
    )


INTERVALS: Final = "Each against its own weeks and against the arms of its kind. In brackets: 95 % interval."
COURSES: Final = (
    "Weekly values with one standard deviation, per cent of their mean, with what the kind does together taken out. "
    "The grey line is what was taken out; the dotted line is a step."
)
HEAT: Final = (
    f"Of each cell, by how much the joint that rose most is above its first {FIRST} weeks, in per cent of friction. "
    "Blank: no recording. Single dark weeks are noise; what is sure is in the table."
)


def _table(findings: Sequence[Finding]) -> Table:
    heads = ("Cell", "Kind", "Joint", "Quantity", "What", "Change, %", "A week, %", "From", "To")
    return Table("Findings", heads, [_row(f) for f in findings])


def _row(f: Finding) -> tuple[str, ...]:
    size, low, high = (fixed(value, 0 if abs(f.percent) >= 10 else 1) for value in (f.percent, f.low, f.high))
    joint = "all" if f.joint is None else str(f.joint)
    what, week = f.what.replace("_", " "), fixed(f.percent_a_week, 2)
    return f.cell, f.kind, joint, f.quantity, what, f"{size} ({low} to {high})", week, f.first, f.last


def _courses(found: Fleet) -> list[Block]:
    by_place = {(c.cell, c.joint, c.quantity): c for c in found.courses}
    shown = dict.fromkeys((f.cell, f.joint, f.quantity) for f in found.findings)
    panels = []
    for key in list(shown)[:MOST_PANELS]:
        steps = [f.first for f in found.findings if (f.cell, f.joint, f.quantity) == key and f.percent_a_week is None]
        marks = [upright(_place(week, found), BAD) for week in steps]
        panels.append(_panel(by_place[key], found, marks))
    if not panels:
        return []
    rows = [panels[i : i + IN_A_ROW] for i in range(0, len(panels), IN_A_ROW)]
    rows[-1] += [Panel([], Axis(labels=False, grid=False), Axis(labels=False, grid=False))] * (IN_A_ROW - len(rows[-1]))
    left = len(shown) - len(panels)
    more: list[Block] = [f"{left} more are in fleet.json."] if left > 0 else []
    label = "Course by week of each finding"
    return [Figure(label, rows, [HEIGHT] * len(rows), legend=False, sides=(46, 14)), *more]


def _panel(course: Weekly, found: Fleet, marks: Sequence[dict[str, object]]) -> Panel:
    x = np.array([_place(week, found) for week in course.weeks])
    values, error = np.array(course.percent), np.array(course.error)
    every = np.arange(int(x[-1] - x[0]) + 1) + x[0]
    low, high = (np.interp(every, x, values + sign * error) for sign in (-1.0, 1.0))
    joint = "" if course.joint is None else f", joint {course.joint}"
    return Panel(
        [
            *ribbon(low, high, MODEL, float(x[0])),
            line("", x, course.kind, MEASURED, width=1.0),
            line("", x, values, MODEL, width=1.2),
            dots("", x, values, MODEL, size=4, opacity=0.9),
        ],
        Axis(ticks=_ticks(found), span=_span(found)),
        Axis(),
        marks=list(marks),
        title=f"{course.cell}{joint}: {course.quantity}, %",
    )


def _place(week: str, found: Fleet) -> int:
    """Week on the axis, from 0 for the first."""
    return (date.fromisoformat(week) - date.fromisoformat(found.first)).days // 7


def _span(found: Fleet) -> tuple[float, float]:
    return -0.6, _place(found.last, found) + 0.6


def _ticks(found: Fleet, about: int = 4) -> dict[float, str]:
    last = _place(found.last, found)
    start = date.fromisoformat(found.first).toordinal()
    step = max(1, round(last / about))
    return {float(w): f"{date.fromordinal(start + 7 * w):%d %b}" for w in range(0, last + 1, step)}


def _all(found: Fleet) -> list[Block]:
    friction: dict[str, list[Weekly]] = {}
    for course in found.courses:
        if course.quantity == "friction":
            friction.setdefault(course.cell, []).append(course)
    if not friction:
        return []
    worn = {f.cell for f in found.findings if f.what == "wears"}
    names = sorted(friction, key=lambda cell: (cell not in worn, cell))
    count = _place(found.last, found) + 1
    table = np.array([_risen(friction[name], count, found) for name in names])
    said = [
        ["no recording" if np.isnan(v) else f"week {w + 1}: {v:+.1f} %" for w, v in enumerate(row)] for row in table
    ]
    shade = np.clip(table, 0.0, None)
    panel = Panel(
        [shaded(np.arange(count), [f"{name} ●" if name in worn else name for name in names], shade, said)],
        Axis(ticks=_ticks(found, 8), grid=False),
        Axis(names=True, grid=False),
    )
    bar = colours(DARKEST, "%", (0, 5, 10, 15, 20, 25), ("0", "5", "10", "15", "20", "25 +"))
    label = "Rise of friction by cell and week"
    return [Figure(label, [[panel]], [CELL_HEIGHT * len(names) + 20], legend=False, sides=(90, 14), layout=bar)]


def _risen(courses: Sequence[Weekly], count: int, found: Fleet) -> Float:
    """Friction (weeks,) of the joint that rose most, above its first weeks, per cent; NaN without a recording."""
    table = np.full((len(courses), count), np.nan)
    for row, course in zip(table, courses, strict=True):
        row[[_place(week, found) for week in course.weeks]] = np.array(course.percent) - np.mean(course.percent[:FIRST])
    ends = [np.mean(np.array(course.percent[-FIRST:])) - np.mean(course.percent[:FIRST]) for course in courses]
    return np.asarray(table[int(np.argmax(ends))])


def _left(found: Fleet) -> list[Block]:
    blocks: list[Block] = []
    notes = [*found.notes, *(f"{c.cell}: {c.statement}" for c in found.cells if c.statement)]
    notes += [f"{f.cell}: {remark}" for f in found.findings for remark in f.remarks]
    notes += [f"{s.cell}: {s.place} was skipped: {s.why}" for s in found.skipped]
    if notes:
        blocks.append(Notes(notes))
    rows = [
        (c.cell, c.kind, str(c.weeks), str(c.repetitions), f"{c.seconds / 60:.0f}", "yes" if c.temperature else "no")
        for c in found.cells
    ]
    heads = ("Cell", "Kind", "Weeks", "Repetitions", "Minutes used", "Joint temperature")
    return [*blocks, Folded("All cells, and what was used of them", [Table("Cells", heads, rows)])]
