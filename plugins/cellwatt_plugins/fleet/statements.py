"""Findings in words and in weeks, from what was judged."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np
from scipy.special import stdtrit

from cellwatt_plugins.fleet.courses import Place, Usual
from cellwatt_plugins.fleet.findings import Cause, Finding
from cellwatt_plugins.fleet.judge import Judged, straight
from cellwatt_plugins.fleet.lake import monday
from cellwatt_plugins.fleet.slopes import Trend
from cellwatt_plugins.fleet.trend import Step, rather_a_step
from cellwatt_plugins.robot import RobotDescription

LIMIT: Final = 0.5
"""Friction is forecast until it is so much above its start, as a share."""
NEAR: Final = 1
"""Weeks by which steps of load and energy may be apart and be one."""
NAMES: Final = {"friction": "friction", "energy": "energy of a repetition", "load": "load"}


def findings_of(
    every: Sequence[Judged], robots: Mapping[str, RobotDescription], usual: Mapping[str, Usual]
) -> list[Finding]:
    """Return all findings, wear first, then by size."""
    loads = {
        (p.cell, s.week)
        for each in every
        if each.courses.quantity == "load"
        for p, ss in each.steps.items()
        for s in ss
    }
    found = []
    for each in every:
        for place in sorted(each.sure):
            robot, own, trend = robots[place.cell], usual[place.cell], each.trends[place]
            step = None if each.steps[place] else rather_a_step(each.own[place], each.rho, trend.chance)
            found.append(
                _of_trend(each, trend, robot, own) if step is None else _of_step(each, place, step, robot, own, loads)
            )
        for place, steps in sorted(each.steps.items()):
            found += [_of_step(each, place, step, robots[place.cell], usual[place.cell], loads) for step in steps]
    return sorted(found, key=lambda f: (f.what != "wears", f.quantity != "friction", -abs(f.percent), f.cell))


def _of_trend(each: Judged, trend: Trend, robot: RobotDescription, usual: Usual) -> Finding:
    quantity, place, line = each.courses.quantity, trend.place, trend.line
    scale = 1.0 if quantity == "load" else 100.0
    change = each.courses.change
    low, high = (scale * change(end * trend.span) for end in trend.interval())
    size, a_week = scale * change(trend.slope * trend.span), scale * change(trend.slope)
    what = _cause(quantity, trend.slope > 0, each)
    first, last, since = (monday(week).isoformat() for week in (line.first, line.last, each.since[place]))
    reaches = _reaches(each, trend) if what == "wears" else None
    unit = "kg" if quantity == "load" else "%"
    who = f"{place.cell}: {_who(place, robot)}{_does(what, quantity)}"
    digits = 1 if quantity == "load" else 0
    said = (
        f"{who} by {abs(size):.{digits}f} {unit} ({min(abs(low), abs(high)):.{digits}f} to "
        f"{max(abs(low), abs(high)):.{digits}f} {unit}) from {first} to {last}; sure since {since}."
    )
    remarks = [*_alone(each, quantity), *_bent(each, place)]
    level = _level(usual, place, line.start + trend.line.slope * trend.span) if quantity == "friction" else None
    return Finding(
        place.cell, each.courses.kind, place.joint or None, quantity, what, size, low, high, a_week, first, last, since,
        trend.chance, level, reaches, said, tuple(remarks),
    )  # fmt: skip


def _of_step(
    each: Judged, place: Place, step: Step, robot: RobotDescription, usual: Usual, loads: set[tuple[str, int]]
) -> Finding:
    quantity = each.courses.quantity
    scale, change = (1.0 if quantity == "load" else 100.0), each.courses.change
    wide = float(stdtrit(max(len(each.own[place].weeks) - 3, 3), 0.975)) * step.error
    low, size, high = (scale * change(x) for x in (step.size - wide, step.size, step.size + wide))
    week = monday(step.week).isoformat()
    unit, digits = ("kg", 1) if quantity == "load" else ("%", 0)
    way = "rose" if size > 0 else "fell"
    why = {
        ("friction", True): "a damage, or another lubricant",
        ("friction", False): "service, or a new gear",
        ("load", True): "another tool or payload",
        ("load", False): "another tool or payload",
    }.get((quantity, size > 0), "another program, tool or controller setting")
    if quantity == "energy" and any(c == place.cell and abs(w - step.week) <= NEAR for c, w in loads):
        why = "with the load, which changed then"
    said = (
        f"{place.cell}: {NAMES[quantity]}{_of_joint(place, robot)} {way} by {abs(size):.{digits}f} {unit} "
        f"({min(abs(low), abs(high)):.{digits}f} to {max(abs(low), abs(high)):.{digits}f} {unit}) at once in the week "
        f"of {week}: {why}."
    )
    what: Cause = "stepped_up" if size > 0 else "stepped_down"
    joint = place.joint or None
    level = _level(usual, place, float(np.mean(each.own[place].values[-3:]))) if quantity == "friction" else None
    return Finding(
        place.cell, each.courses.kind, joint, quantity, what, size, low, high, None, week, week, None, step.chance,
        level, None, said, (),
    )  # fmt: skip


def _cause(quantity: str, rises: bool, each: Judged) -> Cause:
    if quantity == "friction" and rises:
        return "rises" if each.alone and not each.courses.with_temperature else "wears"
    return "drifts" if quantity == "load" else "rises" if rises else "falls"


def _does(what: Cause, quantity: str) -> str:
    if what == "wears":
        return " wears: its friction rose"
    way = {"rises": "rose", "falls": "fell", "drifts": "drifted"}[what]
    return f" {'its ' if quantity == 'friction' else ''}{NAMES[quantity]} {way}".replace("  ", " ")


def _who(place: Place, robot: RobotDescription) -> str:
    return robot.joints[place.joint - 1].name if place.joint else "the arm's"


def _of_joint(place: Place, robot: RobotDescription) -> str:
    return f" of {robot.joints[place.joint - 1].name}" if place.joint else ""


def _alone(each: Judged, quantity: str) -> Iterator[str]:
    if each.alone:
        heat = "" if each.courses.with_temperature or quantity != "friction" else ", nor is its temperature known"
        yield f"fewer than 5 arms of {each.courses.kind} can be compared: a season may look like this{heat}"


def _bent(each: Judged, place: Place) -> Iterator[str]:
    if not straight(each, place):
        yield "the change is not even over the weeks: no forecast"


def _reaches(each: Judged, trend: Trend) -> tuple[str, str] | None:
    """Mondays between which the limit is reached, if within as many weeks as the line has."""
    low, high = trend.interval()
    if low <= 0 or not straight(each, trend.place):
        return None
    early, late = (trend.line.first + float(np.log1p(LIMIT)) / slope for slope in (high, low))
    if early <= trend.line.last or late - trend.line.last > trend.span:
        return None
    return monday(int(early)).isoformat(), monday(int(np.ceil(late))).isoformat()


def _level(usual: Usual, place: Place, log: float) -> float:
    """Nm: the course is about its own mean where the kind's course is taken out."""
    return float(np.exp(log)) if np.isfinite(log) else float(usual.friction[place.joint - 1])
