"""Findings in words and in weeks, from what was judged."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from scipy.special import stdtrit

from cellwatt_plugins.fleet.courses import Place
from cellwatt_plugins.fleet.findings import Cause, Finding
from cellwatt_plugins.fleet.judge import Judged
from cellwatt_plugins.fleet.lake import monday
from cellwatt_plugins.fleet.slopes import Trend
from cellwatt_plugins.fleet.trend import Step
from cellwatt_plugins.robot import RobotDescription

NAMES: Final = {"friction": "friction", "energy": "energy of a repetition"}
WHY: Final = {("friction", True): "a damage, or another lubricant", ("friction", False): "service, or a new gear"}
"""Usual causes of a step, by whether it goes up."""


def findings_of(every: Sequence[Judged], robots: Mapping[str, RobotDescription]) -> list[Finding]:
    """Return all findings, wear first, then by size."""
    found = []
    for each in every:
        found += [_of_trend(each, each.trends[place], robots[place.cell]) for place in sorted(each.sure)]
        found += [_of_step(each, place, step, robots[place.cell]) for place, step in each.steps]
    return sorted(found, key=lambda f: (f.what != "wears", f.quantity != "friction", -abs(f.percent), f.cell))


def _of_trend(each: Judged, trend: Trend, robot: RobotDescription) -> Finding:
    quantity, place, line = each.courses.quantity, trend.place, trend.line
    low, high = (_percent(end * trend.span) for end in trend.interval())
    size = _percent(trend.slope * trend.span)
    what: Cause = "rises" if trend.slope > 0 else "falls"
    way = {"rises": "rose", "falls": "fell"}[what]
    if quantity == "energy":
        said = f"the arm's {NAMES[quantity]} {way}"
    else:
        wears = what == "rises" and (each.courses.with_temperature or not each.alone)
        what = "wears" if wears else what
        said = f"{_joint(place, robot)}{' wears:' if wears else ''} its friction {way}"
    first, last = (monday(week).isoformat() for week in (line.first, line.last))
    remarks = []
    if each.alone:
        heat = "" if each.courses.with_temperature or quantity != "friction" else ", nor is its temperature known"
        remarks = [f"fewer than 5 arms of {each.courses.kind} can be compared: a season may look like this{heat}"]
    return Finding(
        place.cell, each.courses.kind, place.joint or None, quantity, what, size, low, high, _percent(trend.slope),
        first, last, trend.chance, f"{place.cell}: {said} by {_by(size, low, high)} from {first} to {last}.",
        tuple(remarks),
    )  # fmt: skip


def _of_step(each: Judged, place: Place, step: Step, robot: RobotDescription) -> Finding:
    quantity, rises = each.courses.quantity, step.size > 0
    wide = float(stdtrit(max(len(each.own[place].weeks) - 3, 3), 0.975)) * step.error
    low, size, high = (_percent(x) for x in (step.size - wide, step.size, step.size + wide))
    week = monday(step.week).isoformat()
    who = f"{NAMES[quantity]}{f' of {_joint(place, robot)}' if place.joint else ''}"
    why = WHY.get((quantity, rises), "another program, tool, payload or controller setting")
    said = (
        f"{place.cell}: {who} {'rose' if rises else 'fell'} by {_by(size, low, high)} at once in the week of {week}: "
        f"{why}."
    )
    what: Cause = "stepped_up" if rises else "stepped_down"
    return Finding(
        place.cell, each.courses.kind, place.joint or None, quantity, what, size, low, high, None, week, week,
        step.chance, said,
    )  # fmt: skip


def _percent(difference: float) -> float:
    """A difference of logs in per cent."""
    return 100.0 * float(np.expm1(difference))


def _by(size: float, low: float, high: float) -> str:
    return f"{abs(size):.0f} % ({min(abs(low), abs(high)):.0f} to {max(abs(low), abs(high)):.0f} %)"


def _joint(place: Place, robot: RobotDescription) -> str:
    return robot.joints[place.joint - 1].name
