"""``fleet``: compares many recordings of many cells."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from cellwatt.errors import RecordingError
from cellwatt.files import Place as FilePlace
from cellwatt.scheduler import spread
from cellwatt_plugins.fleet.adjusted import Observations
from cellwatt_plugins.fleet.courses import CellJoint, Courses, courses_of_kind, observations_of
from cellwatt_plugins.fleet.findings import CellSummary, Fleet, Weekly, findings_of
from cellwatt_plugins.fleet.judge import LONG_ENOUGH, Judged, judged
from cellwatt_plugins.fleet.kinds import FEWEST
from cellwatt_plugins.fleet.lake import Lake, find, monday
from cellwatt_plugins.fleet.weekly import Week, week_of_cell
from cellwatt_plugins.robot import RobotDescription

WRONG_TORQUE: Final = "torque does not oppose the motion (constant, or of the wrong sign)"
TENFOLD: Final = float(np.log(10.0))
"""Largest rise over all weeks, as a logarithm, that is stated as the smallest which would be found."""
Says = Mapping[tuple[str, int], Observations]
"""Values of the repetitions of a cell, by quantity and joint."""


def fleet(
    lake: FilePlace,
    robots: Sequence[str] = (),
    weeks: int | None = None,
    chance: float = 0.01,
    least: float = 0.05,
) -> Fleet:
    """Compare the cells of a folder of recordings.

    ``robots`` are descriptions as ``[CELLS=]FILE``; if none matches, the nearest robot.yaml above a recording is used.
    ``weeks`` limits the comparison to the last weeks. ``chance`` is the probability of one false finding in the whole
    fleet; trends smaller than ``least`` (a share) are not reported. Raises ``RecordingError`` and ``ConfigError``.
    """
    found = find(Path(lake).absolute(), robots, weeks)  # workers have other working directories
    return compared(found, spread(week_of_cell, found.weeks, "reading cell and week"), chance, least)


def compared(lake: Lake, every: Sequence[Week], chance: float = 0.01, least: float = 0.05) -> Fleet:
    """Compare weeks that were read from a lake. Raises ``RecordingError`` if none of them has a repetition."""
    by_cell: dict[str, list[Week]] = {}
    for week in every:
        if week.repetitions:
            by_cell.setdefault(week.cell, []).append(week)
    cells = {name: (weeks, observations_of(weeks)) for name, weeks in by_cell.items()}
    if not cells:
        first = next((s for w in every for s in w.skipped), next(iter(lake.skipped), None))
        raise RecordingError(
            "no recording of the lake can be used" + (f": {first.place}: {first.why}" if first else "")
        )
    kinds: dict[str, dict[str, Says]] = {}
    for name, (_, observations) in cells.items():
        kinds.setdefault(lake.robots[name].robot, {})[name] = observations
    groups = [group for kind, own in kinds.items() for group in courses_of_kind(kind, own)]
    results = judged(groups, chance, least)
    used = sorted({week.week for weeks, _ in cells.values() for week in weeks})
    return Fleet(
        first=monday(used[0]).isoformat(),
        last=monday(used[-1]).isoformat(),
        weeks=len(used),
        chance_of_false=chance,
        least_percent=100 * least,
        tests=sum(len(each.trends) for each in results),
        findings=findings_of(results, lake.robots),
        cells=[_summary(name, robot, *cells.get(name, ((), {}))) for name, robot in lake.robots.items()],
        skipped=[*lake.skipped, *(skipped for week in every for skipped in week.skipped)],
        notes=_notes(kinds, groups),
        smallest=_smallest(results),
        courses=[_weekly(each, place) for each in results for place in sorted(each.own)],
    )


def _summary(name: str, robot: RobotDescription, weeks: Sequence[Week], observations: Says) -> CellSummary:
    if not weeks:
        return CellSummary(name, robot.robot, 0, 0, 0.0, False, "none of its recordings can be used")
    repetitions = [repetition for week in weeks for repetition in week.repetitions]
    heat = all(repetition.temperature is not None for repetition in repetitions)
    seconds = sum(week.seconds for week in weeks)
    moved = np.any(np.isfinite([week.speed for week in weeks]), axis=0).tolist()
    by_reason: dict[str, list[str]] = {}
    for i, (joint, moves) in enumerate(zip(robot.joints, moved, strict=True), start=1):
        if ("friction", i) not in observations:
            by_reason.setdefault(WRONG_TORQUE if moves else "hardly moves", []).append(joint.name)
    statement = "; ".join(f"{reason}: {', '.join(names)}" for reason, names in sorted(by_reason.items()))
    if len(weeks) < LONG_ENOUGH:
        statement = f"too few weeks: {len(weeks)}, expected {LONG_ENOUGH} or more"
    return CellSummary(name, robot.robot, len(weeks), len(repetitions), float(seconds), heat, statement)


def _notes(kinds: Mapping[str, Mapping[str, Says]], groups: Sequence[Courses]) -> list[str]:
    out = []
    for kind, cells in sorted(kinds.items()):
        if len(cells) < FEWEST:
            out.append(f"{kind}: {len(cells)} arms, fewer than {FEWEST}: the effect of a season is not removed")
        heated = [group for group in groups if group.kind == kind and group.quantity == "friction"]
        if not any(group.with_temperature for group in heated):
            out.append(
                f"{kind}: friction is not corrected for temperature (the joints' is not recorded, or friction does "
                "not follow it): only the common course of the kind is removed"
            )
        elif len(heated) > 1:
            rest = next(group for group in heated if not group.with_temperature)
            out.append(f"{kind}: {rest.cells} arms without temperature are compared with each other only")
        if not any(("energy", 0) in observations for observations in cells.values()):
            out.append(f"{kind}: no energy: no power is recorded, or no motion returns to its start pose")
    return out


def _smallest(results: Sequence[Judged]) -> dict[str, float]:
    out = {}
    for each in results:
        if each.courses.quantity == "friction" and each.trends:
            span = float(np.median([trend.span for trend in each.trends.values()]))
            name = each.courses.kind + (" (with temperature)" if each.courses.with_temperature else "")
            if (rise := each.smallest * span) < TENFOLD:
                out[name] = 100 * float(np.expm1(rise))
    return out


def _weekly(each: Judged, place: CellJoint) -> Weekly:
    course, common = each.own[place], each.common[place.joint]
    about = course.about_mean()
    kind = np.zeros(len(course.weeks)) if common is None else common.values[np.searchsorted(common.weeks, course.weeks)]
    scatter = each.trends[place].line.scatter if place in each.trends else 0.0
    error = np.sqrt(np.diag(about.covariance) + scatter**2)
    days = tuple(monday(int(week)).isoformat() for week in course.weeks)
    drawn = (tuple((100 * values).tolist()) for values in (np.expm1(about.values), error, kind))
    return Weekly(place.cell, place.joint or None, each.courses.quantity, days, *drawn)
