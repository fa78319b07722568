"""Check that a simulation is of its run: same motion, joints, unit and clock."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError
from cellwatt.report.numbers import number
from cellwatt_plugins.explain.input.admission.motion import span
from cellwatt_plugins.explain.input.alignment import LATE, delay
from cellwatt_plugins.explain.input.factors import (
    DEGREES,
    MOVES,
    joints_text,
    order_text,
    recognised,
    usable,
)
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.robot import RobotDescription

FOLLOWS = 0.5
"""Largest error over motion, both rms about their means: controllers track far better, other motions have 1.4."""
MATCHES = 0.25
"""The same for another interpretation of the columns to be accepted, which must also halve the error."""
ALIKE = 0.95
"""Least correlation of a recorded position with its plan, up to a factor."""
NOTICED = 0.15
"""Delay, s, above which a note is given."""
OFFSET = 0.2
"""Constant error of a position, rad, that no controller leaves."""


@dataclass(frozen=True)
class _Pair:
    """Recorded and planned positions (N, n) rad, and the indices of the joints that move in either."""

    name: str
    position: Float
    plan: Float
    moving: NDArray[np.intp]

    def errors(self) -> Float:
        """Error of each moving joint: rms of the difference over rms of the plan, both about their means."""
        return np.asarray((np.std(self.position - self.plan, axis=0) / _scale(self.plan))[self.moving])

    def slopes(self) -> tuple[Float, Float]:
        """Ratio of recorded to planned motion, and their correlation, of each moving joint."""
        q, p = _centred(self.position[:, self.moving]), _centred(self.plan[:, self.moving])
        product = np.sum(q * p, axis=0)
        power = np.sum(p * p, axis=0)
        scale = np.sqrt(np.sum(q * q, axis=0) * power)
        slope = np.divide(product, power, out=np.zeros_like(power), where=scale > 0)
        return slope, np.divide(product, scale, out=np.zeros_like(scale), where=scale > 0)


def check_pairing(run: Run, robot: RobotDescription) -> list[str]:
    """Notes on how the recording follows its plan. Raises ``RecordingError`` if the plan is of another recording."""
    if run.plan is None:
        return []
    rows = usable(run)
    q, plan = run.position[rows], run.plan.position[rows]
    moving = np.flatnonzero(np.maximum(span(q), span(plan)) > MOVES)
    if not len(moving):
        return []
    pair = _Pair(run.name, q, plan, moving)
    samples, remaining = delay(run.position[:, moving], run.plan.position[:, moving])
    late = samples * run.step
    if np.any(pair.errors() > FOLLOWS):
        _unit(pair, robot)
        _sign(pair)
        _clock(pair, late, remaining)
        _order(pair)
        worst = int(moving[np.argmax(pair.errors())])
        off = float(np.std(q[:, worst] - plan[:, worst]))
        raise RecordingError(
            f"{run.name}: the recording does not follow its simulation (joint {worst + 1} is {off:.2f} "
            f"{robot.unit(worst, 'rad')} off, rms): is it the simulation of this run? Simulations belong to "
            "recordings of the same name, or in the same order"
        )
    _clock(pair, late, remaining)
    _offset(pair, robot)
    if abs(late) > NOTICED and remaining < 0.5 * float(np.mean(pair.errors())):
        return [f"{run.name}: the recorded motion comes {late:.2f} s after the simulation's"]
    return []


def _unit(pair: _Pair, robot: RobotDescription) -> None:
    slopes, alike = pair.slopes()
    other = (np.abs(alike) > ALIKE) & ((np.abs(slopes) > 2) | (np.abs(slopes) < 0.5))
    if not other.any():
        return
    factor = float(np.median(np.abs(slopes[other])))
    known = {"degrees against radians": DEGREES, "milliradians against radians": 1e3}
    if (ratio := robot.joints[int(pair.moving[np.argmax(other)])].gear_ratio) > 2:
        known["the motor's angle against the joint's"] = ratio
    name = recognised(max(factor, 1 / factor), known, within=1.25) or "not the same quantity"
    these, those = ("recorded", "simulated") if factor > 1 else ("simulated", "recorded")
    raise RecordingError(
        f"{pair.name}: {these} positions of {joints_text((pair.moving[other] + 1).tolist())} are "
        f"{number(max(factor, 1 / factor))} times the {those} ones ({name}): both must be in rad at the joint"
    )


def _sign(pair: _Pair) -> None:
    _, alike = pair.slopes()
    turned = alike < -ALIKE
    if turned.any() and np.all(np.where(turned, True, pair.errors() < FOLLOWS)):
        joints = joints_text((pair.moving[turned] + 1).tolist())
        raise RecordingError(f"{pair.name}: recorded and simulated positions of {joints} have opposite signs")


def _clock(pair: _Pair, late: float, remaining: float) -> None:
    """Check the clocks; ``late``: delay of the recording behind the plan, s; ``remaining``: the error without it."""
    if abs(late) > LATE and remaining < MATCHES and remaining < 0.5 * float(np.mean(pair.errors())):
        way, change = ("earlier", "add") if late > 0 else ("later", "subtract")
        where = "to" if late > 0 else "from"
        raise RecordingError(
            f"{pair.name}: the simulation makes the same motion {abs(late):.2f} s {way} than the recording: "
            f"{change} {abs(late):.2f} s {where} the simulation's times"
        )


def _order(pair: _Pair) -> None:
    """Check that each recorded column follows the planned joint of its number."""
    difference = _centred(pair.position)[:, :, None] - _centred(pair.plan)[:, None, :]
    cost = np.sqrt(np.mean(difference**2, axis=0)) / _scale(pair.plan)
    lost = np.flatnonzero(np.diag(cost) > FOLLOWS)
    rows, places = linear_sum_assignment(cost[np.ix_(lost, lost)])
    order = np.arange(len(cost))
    order[lost[rows]] = lost[places]
    if np.all(cost[lost, order[lost]] < MATCHES):
        raise RecordingError(
            f"{pair.name}: the joints of the recording are in another order than the simulation's: "
            f"{order_text('q', order.tolist())} of the simulation"
        )


def _offset(pair: _Pair, robot: RobotDescription) -> None:
    """Check the zeros of the positions; whole turns are ignored."""
    offset = np.median(pair.position - pair.plan, axis=0)
    offset -= 2 * np.pi * np.round(offset / (2 * np.pi))
    if np.any(np.abs(offset) > OFFSET):
        joints = np.flatnonzero(np.abs(offset) > OFFSET).tolist()
        raise RecordingError(
            f"{pair.name}: recorded positions of {joints_text([i + 1 for i in joints])} are "
            f"{', '.join(robot.unit(i, f'{offset[i]:.2f} rad') for i in joints)} off the simulated ones throughout: "
            "recording and simulation have different zeros"
        )


def _centred(values: Float) -> Float:
    return np.asarray(values - values.mean(axis=0), np.float64)


def _scale(plan: Float) -> Float:
    return np.asarray(np.maximum(np.std(plan, axis=0), MOVES), np.float64)
