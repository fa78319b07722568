"""Check unit, order and direction of the torques against the motion and the robot's description."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from itertools import combinations

import numpy as np
from scipy.optimize import linear_sum_assignment

from cellwatt.arrays import Bool, Float
from cellwatt.errors import RecordingError
from cellwatt_plugins.explain.input.admission.agreement import (
    SAMPLES,
    Expected,
    Sample,
    Torques,
    deviation,
    sample_of,
)
from cellwatt_plugins.explain.input.factors import (
    DEGREES,
    MOVES,
    joints_text,
    order_text,
    wrong_unit,
)
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.motion import Moved, Plan
from cellwatt_plugins.robot.signs import opposite, to_and_fro

Order = tuple[int, ...]

LARGE, SMALL = 100.0, 1 / 30
"""Ratios of recorded to nominal torque of the whole arm that no friction, load or balancer can cause."""
HELD = 0.1
"""Assumed friction as a share of the rms gravity torque over random poses: an upright arm carries almost nothing."""
POSES = 100
"""Number of random poses for that gravity torque."""
ALONE = 8.0
"""Ratio of one joint's torque to the largest other torque, recorded or nominal, above which its unit is another one."""
HIDDEN = 200.0
"""Factor by which a joint's torque may be below its nominal torque, if that exceeds friction."""
THOUSAND = 1000.0
POOR = 0.05
"""Misfit of a joint above which other interpretations of the columns are tried."""
GOOD = 0.5
"""An interpretation is accepted if its misfit is below this value and below this share of the misfit as recorded."""
TELLS = 0.5
"""Share of a torque's mean square that must not be noise for the torque to be assigned to a joint."""
TIE = 1e-6
"""Preference, in misfit, for leaving a column of noise at its own joint."""
AGREES = 0.3
"""Largest mean misfit of a whole arm if description and interpretation are right; a wrong mounting has more."""
SEVERAL = 0.5
"""Share of the moving joints that must go to and fro for torques to show an order of columns."""
TWICE = 1.9
"""Misfit, nearly 2, of a torque that is right but for its sign, also along one way."""
ROUNDED = 1e-4
"""Rounding of a simulated torque, as a share of its rms."""


def check_torque(run: Run, motion: Moved, arm: Arm) -> None:
    """Raises ``RecordingError`` if another unit, order or direction makes description and recording agree."""
    sample = sample_of(run, motion, arm)
    what = "torque" if run.torque_from == "torque" else "torque from current"
    _check(f"{run.name}: {what}", run.torque_from == "current", sample)


def check_simulated(run: Run, arm: Arm) -> None:
    """``check_torque`` for the torque of a run's simulation."""
    simulated = run.simulated
    if simulated is None:
        return
    thin = max(1, len(simulated.time) // SAMPLES)
    torque = simulated.torque[::thin]
    size = np.sqrt(np.mean(torque**2, axis=0))
    # The torque of a joint that nothing loads is the rounding of numbers that cancel.
    read = Torques(torque, ROUNDED * np.maximum(size, 0.01 * size.max()))
    plan = Plan(*(part[::thin] for part in simulated.plan.courses))
    _check(f"{run.name}: its simulation's torque", False, Sample(arm, read, plan))


def _check(place: str, current: bool, sample: Sample) -> None:
    if not sample.read.torque.any():
        return
    expected = sample.expected()
    poses = np.random.default_rng(0).uniform(-np.pi, np.pi, (POSES, sample.arm.joints))
    friction = HELD * _rms(sample.arm.gravity(poses))
    _whole_unit(place, current, sample, expected.torque, friction)
    misfit = expected.misfits(sample.read)
    if (misfit > POOR).any():
        _direction(place, sample, expected, misfit)
        moves = np.ptp(sample.motion.position, axis=0) > MOVES * sample.arm.body.levers
        if moves.any() and np.mean(to_and_fro(sample.motion.velocity)[moves]) >= SEVERAL:
            _order(place, sample.read, expected)
            _motion_read_otherwise(place, sample, expected.misfit(sample.read))
    _unit_of_one(place, sample.read, replace(expected, strict=True), friction)


def _whole_unit(place: str, current: bool, sample: Sample, expected: Float, friction: float) -> None:
    active = sample.read.torque.any(axis=0)
    recorded, nominal = _rms(sample.read.torque[:, active]), _rms(expected[:, active])
    factor = recorded / max(nominal, 1e-12)
    if factor >= LARGE:
        factor = recorded / max(nominal, friction, 1e-12)
    if SMALL < factor < LARGE or nominal == 0:
        return
    thousand, thousandth = ("in mA", "in kA") if current else ("in mNm", "in kNm")
    known = {thousand: THOUSAND, thousandth: 1 / THOUSAND}
    if (ratio := float(np.median(sample.arm.column("gear_ratio")))) > 1 / SMALL:
        known["that of the motors, before the gears"] = 1 / ratio
    found = wrong_unit(place, factor, "what motion and description require", known, within=3.0)
    raise RecordingError(f"{found}; torques must be in Nm at the joint, currents in A")


def _rms(values: Float) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _unit_of_one(place: str, read: Torques, expected: Expected, friction: float) -> None:
    """Check the unit of each joint, with the description's friction or ``friction`` Nm: any friction fits any unit."""
    torque, misfit = read.torque, expected.misfits(read)
    size, nominal = np.sqrt(np.mean(torque**2, axis=0)), np.sqrt(np.mean(expected.torque**2, axis=0))
    strongest = int(np.argmax(size))
    others = max(nominal.max(), np.delete(size, strongest).max(initial=0.0), friction)
    alone = (np.arange(len(size)) == strongest) & (size > ALONE * others) & (len(size) > 1)
    # Changes of a torque that are no larger than friction may be friction, which the description need not know.
    varies = np.array([deviation(column) for column in torque.T]) > friction
    large = (_better(expected.misfits(read * (1 / THOUSAND)), misfit) & varies) | alone
    # A wrist at rest may carry nothing although the description has a tool: below friction, the unit may be right.
    small = _better(expected.misfits(read * THOUSAND), misfit)
    small |= (size > 0) & (size * HIDDEN < nominal) & (nominal > friction)
    for wrong, name in ((large, "large"), (small, "small")):
        if wrong.any():
            joints = joints_text((np.flatnonzero(wrong) + 1).tolist())
            raise RecordingError(
                f"{place} of {joints} is some thousand times too {name} for motion and description: "
                "torques must be in Nm, currents in A"
            )


def _direction(place: str, sample: Sample, expected: Expected, misfit: Float) -> None:
    """Check the signs: a torque of the wrong sign also gains energy from friction, which is impossible."""
    read, velocity = sample.read, sample.motion.velocity
    turned = _better(expected.misfits(read * -1.0), misfit) & (read.shares() > TELLS)
    turned &= to_and_fro(velocity) | (misfit > TWICE)
    turned &= opposite(read.torque, expected.torque, velocity)
    if turned.any() and not _mounted_upside_down(sample, expected, turned):
        raise RecordingError(
            f"{place} of {joints_text((np.flatnonzero(turned) + 1).tolist())} has the opposite sign: "
            "it drives where the motion requires braking"
        )


def _mounted_upside_down(sample: Sample, expected: Expected, turned: Bool) -> bool:
    """True if gravity of the opposite direction explains the torques as well as other signs of the ``turned`` ones."""
    against = replace(expected, torque=expected.torque - 2 * sample.arm.gravity(sample.motion.position))
    other = expected.misfit(sample.read * np.where(turned, -1.0, 1.0))
    return against.misfit(sample.read) <= other


def _order(place: str, read: Torques, expected: Expected) -> None:
    """Check that each torque column belongs to the joint of its number, the positions being right.

    Columns of noise are assigned to the remaining joints.
    """
    informative = read.shares() > TELLS
    cost = np.where(informative[:, None], np.minimum(expected.table(read), 2.0), 0.0)
    _, order = linear_sum_assignment(cost - TIE * np.eye(len(cost)))
    misplaced = np.flatnonzero((order != np.arange(len(order))) & informative)
    if len(misplaced) and np.all(_better(cost[misplaced, order[misplaced]], cost[misplaced, misplaced])):
        raise RecordingError(
            f"{place}: the columns are in another order than the positions: {order_text('tau', order.tolist())}"
        )


def _motion_read_otherwise(place: str, sample: Sample, before: float) -> None:
    """Check for degrees, a reversed joint or another order of columns: an error only if the whole arm then agrees."""
    if before < POOR:
        return
    read = sample.read
    after = sample.expected(1 / DEGREES).misfit(read)
    if _agrees(after, before):
        raise RecordingError(
            f"{place}: the positions are in degrees: converted to rad, the torques agree with the motion "
            f"({100 * after:.0f} instead of {100 * before:.0f} % off)"
        )
    for joint in range(len(read.noise)):
        turn = np.ones(len(read.noise))
        turn[joint] = -1.0
        expected = sample.expected(turn)
        for torque, what in ((read, "position counts"), (read * turn, "position and torque count")):
            if _agrees(expected.misfit(torque), before):
                raise RecordingError(
                    f"{place}: {what} in the opposite direction at joint {joint + 1} to the robot's description"
                )
    _motion_order(place, sample, before)


def _motion_order(place: str, sample: Sample, before: float) -> None:
    """Check the order of all columns, or of the positions alone: also reversed, with pairs exchanged while it helps."""

    expected = cache(lambda order: sample.expected(order=order))  # both searches below need the same orders

    def whole(order: Order) -> float:
        return float(expected(order).misfit(sample.read.ordered(order)))

    def positions(order: Order) -> float:
        return float(expected(order).misfit(sample.read))

    for misfit, what in ((whole, "joints"), (positions, "positions")):
        own = tuple(range(len(sample.read.noise)))
        best, order = min((before, own), (misfit(own[::-1]), own[::-1]))
        while (found := min((misfit(other), other) for other in _exchanged(order)))[0] < best:
            best, order = found
        if _agrees(best, before):
            raise RecordingError(
                f"{place}: the {what} are in another order than in the robot's description: "
                + order_text("q", np.argsort(order).tolist())
            )


def _exchanged(order: Order) -> Iterator[Order]:
    """All orders in which two joints have changed places."""
    for i, k in combinations(range(len(order)), 2):
        other = list(order)
        other[i], other[k] = order[k], order[i]
        yield tuple(other)


def _better(other: Float, misfit: Float) -> Bool:
    """True (n,) for the joints at which another interpretation is accepted; see ``GOOD``."""
    return np.asarray(other < GOOD * np.minimum(misfit, 1.0), np.bool_)


def _agrees(other: float, misfit: float) -> bool:
    """True if another interpretation of the whole arm is accepted; see ``AGREES``."""
    return other < min(AGREES, GOOD * misfit)
