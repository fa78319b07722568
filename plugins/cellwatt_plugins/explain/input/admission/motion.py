"""Check that positions and velocities describe the motion of an arm, in rad and rad/s."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import convolve1d
from scipy.optimize import linear_sum_assignment

from cellwatt.arrays import Bool, Float
from cellwatt.errors import RecordingError
from cellwatt_plugins.explain.input.factors import (
    DEGREES,
    MOVES,
    RPM,
    order_text,
    usable,
    wrong_unit,
)
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.input.unread import unread
from cellwatt_plugins.robot import Arm, RobotDescription
from cellwatt_plugins.robot.motion import rates

AT_REST = 0.01
"""Travel, rad, below which a joint is at rest."""
WIDE = 0.2
"""Travel, rad, above which the derivative of a position can be compared."""
FLICKER = 0.1
"""Span of velocities, rad/s, that encoder noise produces at a joint at rest."""
BEYOND = 3.0
"""Factor on the joint's limit, or on half a turn if that is more, that no arm reaches."""
FASTEST = 30.0
"""Speed, rad/s, that no joint of an arm reaches."""
LEAP = 10.0
"""Speed, rad/s, above which half a turn from sample to sample is not motion."""
ALIKE = 0.9
"""Correlation, not about the mean, above which two velocities are of the same motion."""
UNLIKE = 0.3
"""Correlation below which two velocities are of different motions."""
FOREIGN = 0.8
"""Correlation of a velocity with its joint below which it is another joint's, if it agrees with that joint."""
SIMPSON = (1 / 6, 4 / 6, 1 / 6)
"""Weights of three samples of a velocity in its mean over two steps."""
FACTOR = 2.0
"""Factor between a velocity and the derivative of its position that has no physical cause."""


def span(values: Float) -> Float:
    """Span (n,) of each column (N, n), from its 1st to its 99th percentile."""
    low, high = np.percentile(values, [1, 99], axis=0)
    return np.asarray(high - low, np.float64)


def travel(run: Run) -> Float:
    """Span (n,), in rad or m, of each joint in the samples that were not filled in."""
    return span(run.position[usable(run)])


def check_moving(runs: Sequence[Run], arm: Arm) -> None:
    """Raises ``RecordingError`` if every joint with torque is at rest in all runs."""
    widest = np.max([np.where(unread(run), 0.0, travel(run)) for run in runs], axis=0)
    share = widest / (AT_REST * arm.body.levers)
    most = int(np.argmax(share))
    if share[most] < 1:
        names = runs[0].name if len(runs) == 1 else "the recordings"
        way = f"{widest[most]:.4f} {arm.description.unit(most, 'rad')}"
        raise RecordingError(
            f"{names}: nothing moves (at most {way} at a joint whose torque was recorded): at rest only "
            "standby power and holding torques are visible; record at least some seconds of motion of every joint"
        )


def check_stuck(run: Run) -> None:
    """Raises ``RecordingError`` if a signal stays at one value although the joint moves."""
    moves = travel(run) > MOVES
    wanted = np.zeros(run.joints, bool) if run.plan is None else span(run.plan.position) > MOVES
    if run.velocity is not None:
        wanted |= _travelled(run.velocity, run.step)
        _stuck(run, "qd", run.velocity, moves, "the joint moves")
    _stuck(run, "q", run.position, wanted, "velocity or simulation show that the joint moves")
    if run.power is not None and moves.any() and np.ptp(run.power) == 0:
        raise RecordingError(
            f"{run.name}: power is {run.power[0]:.6g} in every sample although the arm moves: was the meter read?"
        )


def check_limits(run: Run, arm: Arm) -> None:
    """Raises ``RecordingError`` if at least half of the moving joints exceed the positions or speeds of any arm.

    A single joint may turn without end.
    """
    reached = np.percentile(np.abs(run.position), 99, axis=0)
    speed = np.percentile(np.abs(rates(run.position, run.step)[1]), 99, axis=0)
    beyond = (reached > BEYOND * np.maximum(np.abs(arm.limits).max(axis=1), np.pi)) | (speed > FASTEST)
    if beyond.sum() >= max(1, np.ceil((travel(run) > MOVES).sum() / 2)):
        worst = int(np.argmax(np.where(beyond, reached, 0)))
        raise RecordingError(
            f"{run.name}: joint {worst + 1} reaches {reached[worst]:.1f} and {speed[worst]:.1f} per second, beyond "
            "what an arm does: positions must be in rad and times in s; are they in degrees? Write the unit into "
            "the names, as q_1 [deg], or name yours by --columns 'q [deg]=YOURS{}'"
        )


def check_jumps(run: Run, robot: RobotDescription) -> None:
    """Raises ``RecordingError`` if a revolute joint jumps by more than half a turn between two samples."""
    turning = np.array([joint.kind == "revolute" for joint in robot.joints])
    steps = np.abs(np.diff(run.position, axis=0)) * turning
    leaps = (steps > np.pi) & (steps > LEAP * run.step)
    leaps &= ~(run.filled[1:] | run.filled[:-1])[:, None]
    if leaps.any():
        row, joint = map(int, np.argwhere(leaps)[0])
        raise RecordingError(
            f"{run.name}: q_{joint + 1} jumps by {steps[row, joint]:.2f} rad at t = {run.time[row + 1]:.3f} s (sample "
            f"{row + 2}): if its angle is modulo a turn, record it unwrapped; if two recordings are joined, split them"
        )


def check_velocity(run: Run, robot: RobotDescription) -> None:
    """Raises ``RecordingError`` if the velocities are not the derivatives of the positions."""
    if run.velocity is None:
        return
    rows = usable(run)
    # Central differences of a slow log are means over two steps: the recorded velocities are averaged alike.
    velocity = convolve1d(run.velocity, SIMPSON, axis=0, mode="nearest")[rows]
    own = rates(run.position, run.step)[1][rows]
    wide = np.flatnonzero(travel(run) > WIDE)
    if not len(wide):
        return
    alike = _correlations(velocity, own)
    _velocity_order(run, alike, wide)
    for i in wide:
        factor = float(np.sqrt(np.mean(velocity[:, i] ** 2) / np.mean(own[:, i] ** 2)))
        _velocity_unit(f"{run.name}: velocity of joint {i + 1}", factor, float(alike[i, i]), robot.joints[i].gear_ratio)


def _velocity_order(run: Run, alike: Float, wide: NDArray[np.intp]) -> None:
    """Flag a velocity only if it disagrees with its own joint and agrees with another: joints may move together."""
    matrix = np.abs(alike[np.ix_(wide, wide)])
    rows, places = linear_sum_assignment(-matrix)
    order = np.arange(run.joints)
    order[wide[rows]] = wide[places]
    other = np.flatnonzero(order != np.arange(run.joints))
    if (
        len(other)
        and np.all(np.abs(alike[other, other]) < FOREIGN)
        and np.all(np.abs(alike[other, order[other]]) > ALIKE)
    ):
        raise RecordingError(
            f"{run.name}: the velocities are in another order than the positions: {order_text('qd', order.tolist())}"
        )


def _velocity_unit(where: str, factor: float, alike: float, ratio: float) -> None:
    """Check the ratio ``factor`` of a velocity to its position's derivative, and their correlation ``alike``."""
    if abs(alike) < UNLIKE:
        raise RecordingError(
            f"{where} is not the derivative of its position (correlation {alike:.2f}): is it of another joint or run?"
        )
    if alike < -ALIKE:
        raise RecordingError(f"{where} has the opposite sign of its position's derivative: invert one of them")
    if not 1 / FACTOR < factor < FACTOR and alike > ALIKE:
        known = {"in degrees/s": DEGREES, "in rpm": RPM, "in mrad/s": 1e3, "against positions in degrees": 1 / DEGREES}
        if ratio > FACTOR:
            known |= {"that of the motor": ratio, "that of the motor, in rpm": RPM * ratio}
        found = wrong_unit(where, factor, "the derivative of its position", known)
        raise RecordingError(f"{found}; q must be in rad, qd in rad/s at the joint")


def _travelled(velocity: Float, step: float) -> Bool:
    """(n,) true where velocities (N, n) rad/s are of a joint that travels, not the noise of a joint at rest."""
    way = np.cumsum(velocity - velocity.mean(axis=0), axis=0) * step
    return np.asarray((span(velocity) > FLICKER) & (np.ptp(way, axis=0) > MOVES), np.bool_)


def _stuck(run: Run, stem: str, values: Float, expected: Bool, why: str) -> None:
    stays = np.flatnonzero(expected & (np.ptp(values, axis=0) == 0))
    if len(stays):
        names = ", ".join(f"{stem}_{i + 1}" for i in stays)
        raise RecordingError(f"{run.name}: {names} stays at one value in every sample although {why}: was it recorded?")


def _correlations(a: Float, b: Float) -> Float:
    """Correlation (n, n), about 0, of each column (N, n) of ``a`` with each of ``b``; 0 where one is 0 throughout."""
    scale = np.outer(np.linalg.norm(a, axis=0), np.linalg.norm(b, axis=0))
    return np.asarray(np.divide(a.T @ b, scale, out=np.zeros_like(scale), where=scale > 0), np.float64)
