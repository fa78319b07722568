"""Results of a fleet as written to fleet.json: findings with statements, and weekly courses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any, Final, Literal

import numpy as np
from scipy.special import stdtrit

from cellwatt_plugins.fleet.courses import CellJoint
from cellwatt_plugins.fleet.judge import Judged
from cellwatt_plugins.fleet.lake import Skipped, monday
from cellwatt_plugins.fleet.slopes import Trend
from cellwatt_plugins.fleet.trend import Step
from cellwatt_plugins.robot import RobotDescription

Cause = Literal["wears", "rises", "falls", "stepped_up", "stepped_down"]


@dataclass(frozen=True)
class Finding:
    """A change in one arm that the other arms of its kind do not show.

    ``joint`` is 1-based, None for the whole arm; ``quantity`` is friction, or energy (of a repetition). ``percent`` is
    the change from ``first`` to ``last`` (Mondays of their weeks), or at a step, with its 95 % interval ``low`` to
    ``high``; ``percent_a_week`` is None for a step. ``chance`` is the probability of an equally clear change by chance
    in one course.
    """

    cell: str
    kind: str
    joint: int | None
    quantity: str
    what: Cause
    percent: float
    low: float
    high: float
    percent_a_week: float | None
    first: str
    last: str
    chance: float
    statement: str
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True)
class Weekly:
    """The course of a joint's friction, or of a cell's energy, for plots, percent from its mean.

    ``error`` is one standard deviation, ``kind`` the common course of the kind in these weeks, already subtracted.
    """

    cell: str
    joint: int | None
    quantity: str
    weeks: tuple[str, ...]
    percent: tuple[float, ...]
    error: tuple[float, ...]
    kind: tuple[float, ...]


@dataclass(frozen=True)
class CellSummary:
    """A cell and the amount of its data that was used."""

    cell: str
    kind: str
    weeks: int
    repetitions: int
    seconds: float
    temperature: bool
    statement: str


@dataclass(frozen=True)
class Fleet:
    """All results of a fleet."""

    first: str
    last: str
    weeks: int
    chance_of_false: float
    least_percent: float
    tests: int
    findings: Sequence[Finding]
    cells: Sequence[CellSummary]
    skipped: Sequence[Skipped]
    notes: Sequence[str]
    smallest: Mapping[str, float]
    """Smallest change over all weeks, percent, that would be found in half the joints of a kind; by kind."""
    courses: Sequence[Weekly] = field(default_factory=tuple)

    @property
    def headline(self) -> str:
        """The verdict in one sentence."""
        worn = sum(f.what == "wears" for f in self.findings)
        other = len({f.cell for f in self.findings if f.what != "wears"})
        scope = f"{len(self.cells)} cell{'s' * (len(self.cells) != 1)} over {self.weeks} weeks"
        if not self.findings:
            return f"No joint wears and no cell drifts, of {scope}."
        wear = f"{worn} joints wear" if worn != 1 else "1 joint wears"
        return f"{wear}, {other} cell{'s' * (other != 1)} changed otherwise, of {scope}."

    def as_json(self) -> dict[str, Any]:
        """Return the content of fleet.json."""
        return asdict(self)


NAMES: Final = {"friction": "friction", "energy": "energy of a repetition"}
CAUSES: Final[dict[tuple[str, bool], str]] = {
    ("friction", True): "damage, or another lubricant",
    ("friction", False): "service, or a new gear",
}
"""Usual causes of a step by quantity and direction (True: up)."""


def findings_of(every: Sequence[Judged], robots: Mapping[str, RobotDescription]) -> list[Finding]:
    """Return all findings: wear first, then other friction, then energy, each by size."""
    found = []
    for each in every:
        found += [_of_trend(each, each.trends[place], robots[place.cell]) for place in sorted(each.sure)]
        found += [_of_step(each, place, step, robots[place.cell]) for place, step in each.steps]
    return sorted(found, key=lambda f: (f.what != "wears", f.quantity != "friction", -abs(f.percent), f.cell))


def _of_trend(each: Judged, trend: Trend, robot: RobotDescription) -> Finding:
    quantity, place, rises = each.courses.quantity, trend.place, trend.slope > 0
    low, high = (_percent(end * trend.span) for end in trend.interval())
    size, warm = _percent(trend.slope * trend.span), each.courses.with_temperature
    wears = rises and quantity == "friction" and (warm or not each.alone)
    who = f"{_joint(place, robot)}{' wears:' if wears else ''} its" if quantity == "friction" else "the arm's"
    first, last = (monday(week).isoformat() for week in (trend.line.first, trend.line.last))
    statement = (
        f"{who} {NAMES[quantity]} {'rose' if rises else 'fell'} by {_by(size, low, high)} from {first} to {last}."
    )
    heat = ", and its temperature is unknown" if quantity == "friction" and not warm else ""
    remark = f"fewer than 5 arms of {each.courses.kind} can be compared: a season may look like this{heat}"
    what: Cause = "wears" if wears else "rises" if rises else "falls"
    return Finding(
        place.cell, each.courses.kind, place.joint or None, quantity, what, size, low, high, _percent(trend.slope),
        first, last, trend.chance, f"{place.cell}: {statement}", (remark,) if each.alone else (),
    )  # fmt: skip


def _of_step(each: Judged, place: CellJoint, step: Step, robot: RobotDescription) -> Finding:
    quantity, rises = each.courses.quantity, step.size > 0
    wide = float(stdtrit(max(len(each.own[place].weeks) - 3, 3), 0.975)) * step.error
    low, size, high = (_percent(x) for x in (step.size - wide, step.size, step.size + wide))
    week = monday(step.week).isoformat()
    who = f"{NAMES[quantity]}{f' of {_joint(place, robot)}' if place.joint else ''} {'rose' if rises else 'fell'}"
    why = CAUSES.get((quantity, rises), "another program, tool, payload or controller setting")
    statement = f"{place.cell}: {who} by {_by(size, low, high)} at once in the week of {week}: {why}."
    return Finding(
        place.cell, each.courses.kind, place.joint or None, quantity, "stepped_up" if rises else "stepped_down", size,
        low, high, None, week, week, step.chance, statement,
    )  # fmt: skip


def _percent(difference: float) -> float:
    """Convert a difference of logarithms to percent."""
    return 100.0 * float(np.expm1(difference))


def _by(size: float, low: float, high: float) -> str:
    return f"{abs(size):.0f} % ({min(abs(low), abs(high)):.0f} to {max(abs(low), abs(high)):.0f} %)"


def _joint(place: CellJoint, robot: RobotDescription) -> str:
    return robot.joints[place.joint - 1].name
