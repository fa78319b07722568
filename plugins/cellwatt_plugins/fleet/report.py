"""HTML report of a fleet: the table of findings, then their courses."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date
from typing import Final

import numpy as np

from cellwatt.report import Axis, Block, Figure, Folded, Notes, Panel, Report, Section, Table, Tile
from cellwatt.report.drawing import dots, line, ribbon, upright
from cellwatt.report.numbers import fixed
from cellwatt.report.theme import BAD, MEASURED, MODEL
from cellwatt_plugins.fleet.findings import Finding, Fleet, Weekly

IN_A_ROW: Final = 3
"""Panels per row."""
TICKS: Final = 4
"""Approximate number of ticks per panel."""
MOST_PANELS: Final = 24
HEIGHT: Final = 150
"""Height of a panel, pixels."""


def report_of(found: Fleet, name: str) -> Report:
    """Return the report of a fleet; ``name`` is the name of the lake."""
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
            f"{found.tests} courses were tested. Changes below {found.least_percent:g} % are not reported. Half the "
            f"joints would show a rise over all weeks of: {smallest or 'not known'}."
        ),
        sections=[
            Section("What changed", [_table(found.findings)] if found.findings else [], INTERVALS),
            Section("Courses of the findings", _courses(found), COURSES),
            Section("Data not used, and notes", _unused(found)),
        ],
    )


INTERVALS: Final = "Each compared with its own weeks and with the arms of its kind. In brackets: 95 % interval."
COURSES: Final = (
    "Weekly values with one standard deviation, per cent of their mean, with the common course of the kind subtracted. "
    "The grey line is the common course; the dotted line is a step."
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
    unshown = len(shown) - len(panels)
    more: list[Block] = [f"{unshown} more are in fleet.json."] if unshown > 0 else []
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
        Axis(ticks=_ticks(found), span=(-0.6, _place(found.last, found) + 0.6)),
        Axis(),
        marks=list(marks),
        title=f"{course.cell}{joint}: {course.quantity}, %",
    )


def _place(week: str, found: Fleet) -> int:
    """Position of a week on the axis; the first is 0."""
    return (date.fromisoformat(week) - date.fromisoformat(found.first)).days // 7


def _ticks(found: Fleet) -> dict[float, str]:
    last = _place(found.last, found)
    start = date.fromisoformat(found.first).toordinal()
    step = max(1, round(last / TICKS))
    return {float(w): f"{date.fromordinal(start + 7 * w):%d %b}" for w in range(0, last + 1, step)}


def _unused(found: Fleet) -> list[Block]:
    notes = [*found.notes, *(f"{c.cell}: {c.statement}" for c in found.cells if c.statement)]
    notes += [f"{f.cell}: {remark}" for f in found.findings for remark in f.remarks]
    notes += [f"{s.cell}: {s.place} was skipped: {s.why}" for s in found.skipped]
    rows = [
        (c.cell, c.kind, str(c.weeks), str(c.repetitions), f"{c.seconds / 60:.0f}", "yes" if c.temperature else "no")
        for c in found.cells
    ]
    heads = ("Cell", "Kind", "Weeks", "Repetitions", "Minutes used", "Joint temperature")
    return [Notes(notes), Folded("All cells and the data used", [Table("Cells", heads, rows)])]
