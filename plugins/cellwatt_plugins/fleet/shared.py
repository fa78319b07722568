"""Differences that most arms of a kind have from their description, and changes that they make together."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from cellwatt.report.numbers import listed
from cellwatt_plugins.fleet.adjusted import Course
from cellwatt_plugins.fleet.courses import Usual
from cellwatt_plugins.fleet.findings import Shared
from cellwatt_plugins.fleet.judge import Judged
from cellwatt_plugins.fleet.kinds import FEWEST, Common
from cellwatt_plugins.fleet.trend import line
from cellwatt_plugins.robot import RobotDescription

Float = NDArray[np.float64]

MOST: Final = 0.8
"""Share of the arms of a kind that must differ with one sign."""
SURE: Final = 4.0
"""Errors that the median of the arms must be away from the description."""
HEAVY: Final = 3
"""Joints from the base that hold and move enough to tell whether masses are right."""
LEAST_LOAD: Final = 0.3
"""kg of load that is worth telling."""


@dataclass(frozen=True)
class CellValues:
    """Medians over the weeks of one cell."""

    usual: Usual
    gain: Float
    """(n,) rigid torque beyond the description, as a share of it."""
    load: float
    """kg."""


@dataclass(frozen=True)
class _Middle:
    """Median over arms."""

    arms: int
    same: int
    value: float
    low: float
    high: float
    sure: bool


def differences(kind: str, robot: RobotDescription, cells: Mapping[str, CellValues]) -> Iterator[Shared]:
    """Iterate over what is wrong in the description of a kind, from what its cells show."""
    tolerance = robot.tolerances
    for i, joint in enumerate(robot.joints):
        usual = [each.usual for each in cells.values()]
        speed = np.array([each.speed[i] for each in usual])
        found = np.array([each.friction[i] for each in usual])
        stated = joint.coulomb_friction + joint.viscous_friction * speed
        middle = _middle(np.log(found / stated)) if joint.coulomb_friction + joint.viscous_friction > 0 else None
        if middle is not None and middle.sure and abs(middle.value) > tolerance.friction:
            yield _friction(kind, robot, i, usual, middle)
        gain = _middle(np.log1p(np.array([each.gain[i] for each in cells.values()])))
        least = tolerance.torque_gain or (0.1 if robot.torque_from == "current" else tolerance.link)
        if gain is not None and gain.sure and abs(gain.value) > least and i < HEAVY:
            yield _rigid(kind, robot, i, gain)
    load = _middle(np.array([each.load for each in cells.values()]))
    if load is not None and load.sure and abs(load.value) > LEAST_LOAD:
        yield _load(kind, load)


def together(kind: str, robot: RobotDescription, each: Judged, least: float) -> Iterator[Shared]:
    """Iterate over the change of friction that all arms of a kind make, if in any joint it is ``least`` or more."""
    changes = {joint: _change(shared, each.rho) for joint, shared in each.common.items() if shared is not None}
    told = {
        joint: change for joint, change in sorted(changes.items()) if change is not None and abs(change[0]) >= least
    }
    if not told:
        return
    size, low, high = (100 * float(np.median([change[k] for change in told.values()])) for k in range(3))
    names = listed([robot.joints[joint - 1].name for joint in told])
    why = (
        "although it is brought to one temperature"
        if each.courses.with_temperature
        else "as a season does; the joints' temperature is not recorded"
    )
    cells = each.courses.cells
    said = (
        f"{kind}: friction of {names} {'rose' if size > 0 else 'fell'} by about {abs(size):.0f} % in the median of "
        f"{cells} arms, {why}. It is taken out of each arm."
    )
    joint = next(iter(told)) if len(told) == 1 else None
    yield Shared(kind, joint, "friction", "together", cells, cells, size, low, high, {}, {}, said)


def _change(shared: Common, rho: float) -> tuple[float, float, float] | None:
    """What a kind's median course changes by, with its interval, as shares; None where that is not sure."""
    course = Course(shared.weeks, shared.values, np.zeros((len(shared.weeks),) * 2))
    found = line(course, rho)
    if found is None or abs(found.slope) < SURE * found.error:
        return None
    span = found.last - found.first
    wide = float(student.ppf(0.975, found.free)) * found.error * span
    size, low, high = (float(np.expm1(found.slope * span + end)) for end in (0.0, -wide, wide))
    return size, low, high


def _middle(values: Float) -> _Middle | None:
    """Median of the arms whose value is known; None where they are too few."""
    known = values[np.isfinite(values)]
    if len(known) < FEWEST:
        return None
    value = float(np.median(known))
    spread = 1.4826 * float(np.median(np.abs(known - value)))
    error = max(1.2533 * spread / np.sqrt(len(known)), 1e-9)
    same = int(np.sum(np.sign(known) == np.sign(value)))
    wide = float(student.ppf(0.975, len(known) - 1)) * error
    sure = same >= MOST * len(known) and abs(value) > SURE * error
    return _Middle(len(known), same, value, value - wide, value + wide, sure)


def _friction(kind: str, robot: RobotDescription, i: int, usual: Sequence[Usual], middle: _Middle) -> Shared:
    joint = robot.joints[i]
    found = {
        "coulomb_friction": float(np.median([each.coulomb[i] for each in usual])),
        "viscous_friction": float(np.median([each.viscous[i] for each in usual])),
    }
    described = {"coulomb_friction": joint.coulomb_friction, "viscous_friction": joint.viscous_friction}
    low, value, high = (100 * float(np.expm1(x)) for x in (middle.low, middle.value, middle.high))
    said = (
        f"{kind}: {joint.name} has {abs(value):.0f} % {_more(value)} friction than robot.yaml says, in {middle.same} "
        f"of {middle.arms} arms: write coulomb_friction: {found['coulomb_friction']:.3g} and viscous_friction: "
        f"{found['viscous_friction']:.3g}."
    )
    return Shared(
        kind, i + 1, "friction", "description", middle.arms, middle.same, value, low, high, found, described, said
    )


def _rigid(kind: str, robot: RobotDescription, i: int, middle: _Middle) -> Shared:
    low, value, high = (100 * float(np.expm1(x)) for x in (middle.low, middle.value, middle.high))
    said = (
        f"{kind}: {robot.joints[i].name} needs {abs(value):.0f} % {_more(value)} torque to hold and move the arm than "
        f"its URDF says, in {middle.same} of {middle.arms} arms: a tool, masses, or torque_constant."
    )
    return Shared(kind, i + 1, "gain", "description", middle.arms, middle.same, value, low, high, {}, {}, said)


def _load(kind: str, middle: _Middle) -> Shared:
    said = (
        f"{kind}: {middle.same} of {middle.arms} arms carry about {abs(middle.value):.1f} kg {_more(middle.value)} at "
        f"the last link than its URDF has ({middle.low:.1f} to {middle.high:.1f} kg): tool and usual payload."
    )
    numbers = {"mass": middle.value}
    return Shared(
        kind,
        None,
        "load",
        "description",
        middle.arms,
        middle.same,
        middle.value,
        middle.low,
        middle.high,
        numbers,
        {},
        said,
    )


def _more(value: float) -> str:
    return "more" if value > 0 else "less"
