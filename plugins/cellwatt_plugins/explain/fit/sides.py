"""The two sides of an arm as problems: measured samples, their variance, and the rows that are fitted."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.holding import held_at_rest
from cellwatt_plugins.explain.fit.metering import Metering
from cellwatt_plugins.explain.fit.noise import floor
from cellwatt_plugins.explain.fit.nuisance import supply_nuisance, torque_nuisance
from cellwatt_plugins.explain.fit.problem import FILLED_VARIANCE, UNKNOWN_VARIANCE, Problem
from cellwatt_plugins.explain.fit.rows import Filtered, Rows, Thinned, filtered, thinned
from cellwatt_plugins.explain.input.factors import MOVES
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.noise import step_noise
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import smooth
from cellwatt_plugins.robot.servo.filtered import EDGE
from cellwatt_plugins.robot.servo.filtered import noise as noise_of

FINEST = 0.002
"""Smallest noise floor, as a share of the measured values: no law of an arm is more accurate."""
LAWS = 0.005
"""The same where a servo's law replaces measured torque."""
LEAK = 0.15
"""Share of a joint's rattling, too fast to be compared, that may appear as a slow torque because a drive clips it."""
RATTLES = 3.0
"""Fast torque above which a joint rattles, in units of the considerable torque of that joint."""
STOP = 0.1
"""s for which the sign of the velocity stays unknown at a stop."""


def torque_problem(
    runs: Sequence[Run], states: Sequence[States], turning: Float | None = None, late: float = 0.0
) -> Problem:
    """The joints' torques of all runs as a problem.

    ``turning`` (n,) Nm is friction beyond the nominal that reverses with the velocity: samples count less where the
    sign of the velocity is uncertain. Uncertainty of the motion appears in the torque within ``late`` s.
    """
    robot = states[0].robot
    known = _measured(runs, states)
    target = tuple(np.where(own, run.torque - s.nominal, 0.0) for run, s, own in zip(runs, states, known, strict=True))
    measured = np.concatenate([np.where(own, run.torque, np.nan) for run, own in zip(runs, known, strict=True)])
    silent = ~np.concatenate(known).any(axis=0)
    measured[:, silent] = 0.0
    spread = np.where(silent, 1.0, np.nanstd(measured, axis=0))
    drive = states[0].drive
    finest = np.maximum((FINEST if drive is None else LAWS) * spread, step_noise(measured))
    counted = [own & ~run.filled[:, None] for run, own in zip(runs, known, strict=True)]
    quiet = floor(target, [run.step for run in runs], counted) if drive is None else encoder_floor(states)
    noise = np.where(silent, 1.0, np.maximum(quiet, finest))
    least = 0.03 * spread
    coulomb = np.maximum(robot.column("coulomb_friction"), least) + (0.0 if turning is None else turning)
    at_rest = held_at_rest(states, target, noise) / coulomb
    # An unknown sign near a stop is wrong for the whole stop: the samples of a stop are one draw, not many.
    variance = []
    for run, s, own in zip(runs, states, known, strict=True):
        unsure = np.square(coulomb) * _unsure(s.motors, at_rest) * max(1.0, STOP / run.step)
        unsure = unsure if s.arm.coupling is None else unsure @ np.square(s.arm.coupling)
        unsure += np.square((s.own_inertia + robot.column("rotor_inertia")) * s.moved.acceleration_spread)
        unsure += 0.0 if s.drive is None else np.square(s.drive.taken)
        whole = _without_gaps(noise**2 + _until(unsure, round(late / run.step)), run)
        variance.append(np.where(own & _between_ends(run), whole, UNKNOWN_VARIANCE * noise**2))
    size = np.maximum(robot.column("coulomb_friction"), 0.1 * spread)
    rows: tuple[Thinned, ...] = thinned(runs)
    if drive is not None:
        rows = slow = filtered(runs)
        least = np.hypot(size, encoder_floor(states, fast=True))
        variance = [v + rattling(part, r, least) for v, part, r in zip(variance, target, slow, strict=True)]
    return Problem(
        side="torque",
        states=tuple(states),
        rows=rows,
        target=tuple(r.of(part) for r, part in zip(rows, target, strict=True)),
        variance=tuple(r.variance(part) for r, part in zip(rows, variance, strict=True)),
        floor=noise,
        size=size,
        nuisance=torque_nuisance(states),
        measured=spread,
    )


def rattling(target: Float, rows: Filtered, least: Float) -> Float:
    """Variance (N, n) Nm² that a rattling joint adds to the slow part of a run's target (N, n) Nm.

    ``least`` (n,) Nm is the torque of a reversal's friction and of the encoders' noise, which is not rattling.
    """
    fast = target - smooth(target, rows.sample_step, rows.bandwidth)
    power = uniform_filter1d(np.square(fast), max(1, round(EDGE / rows.sample_step)), axis=0)
    return np.asarray(np.where(power > np.square(RATTLES * least), np.square(LEAK) * power, 0.0))


def _until(values: Float, rows: int) -> Float:
    """Maximum of values (N, n) over the given number of rows before each row, or after it if ``rows`` is negative."""
    if rows < 0:
        return _until(values[::-1], -rows)[::-1]
    return np.asarray(maximum_filter1d(values, rows + 1, axis=0, origin=rows // 2))


def _unsure(states: States, at_rest: Float) -> Float:
    """Variance (N, n) of friction, in units of Coulomb friction squared: of its sign, and of the friction at rest.

    ``at_rest`` (n,) is the friction observed at rest, as a share of Coulomb friction.
    """
    turning = states.turning
    return np.square(turning.spread) + np.square(np.where(states.resting, np.minimum(at_rest, 1.0), turning.held))


def _measured(runs: Sequence[Run], states: Sequence[States]) -> list[NDArray[np.bool_]]:
    """(N, n) of each run: true where the torque was measured at a joint that moves in any run.

    At rest friction holds any torque, so a joint that never moves gives no evidence.
    """
    moves = np.max([np.ptp(s.q, axis=0) for s in states], axis=0) > MOVES * states[0].arm.body.levers
    return [np.isfinite(run.torque) & moves for run in runs]


def supply_problem(
    runs: Sequence[Run], states: Sequence[States], doubt: Sequence[Float], meter: Metering | None = None
) -> Problem | None:
    """The supply's power of the runs that recorded it; None if no run has power.

    States carry the torque that moves the arm, known to within ``doubt`` (N, n) Nm. Values of a slow ``meter`` are
    compared with means over the time that each value covers.
    """
    powered = [(i, run.power) for i, run in enumerate(runs) if run.power is not None]
    if not powered:
        return None
    chosen = tuple(states[i] for i, _ in powered)
    rows: tuple[Rows, ...]
    shown: Sequence[Float]
    if meter is None:
        rows, shown = thinned([runs[i] for i, _ in powered]), [power for _, power in powered]
        target = [(power - s.nominal_power)[:, None] for power, s in zip(shown, chosen, strict=True)]
        noise = floor(target, [runs[i].step for i, _ in powered], [~runs[i].filled[:, None] for i, _ in powered])
        target = [r.of(part) for r, part in zip(rows, target, strict=True)]
    else:
        rows, shown = meter.rows, meter.values
        target = [(power - r.of(s.nominal_power))[:, None] for power, r, s in zip(shown, rows, chosen, strict=True)]
        noise = floor(target, [r.step for r in rows])
    variance = []
    for (i, _), r, s in zip(powered, rows, chosen, strict=True):
        unsure = np.square(s.qd * doubt[i]) + np.square(s.torque * s.moved.velocity_spread)
        variance.append(r.of(_without_gaps(noise[0] ** 2 + np.sum(unsure, axis=1, keepdims=True), runs[i])))
    power = np.concatenate(shown)
    size = np.array([max(0.1 * float(np.std(power)), 0.03 * float(np.mean(power)), noise[0])])
    return Problem(
        side="supply",
        states=chosen,
        rows=rows,
        target=tuple(target),
        variance=tuple(variance),
        floor=noise,
        size=size,
        nuisance=supply_nuisance(chosen),
        measured=np.array([np.std(power)]),
    )


def encoder_floor(states: Sequence[States], fast: bool = False) -> Float:
    """Noise (n,) Nm from the encoders alone in the servos' law minus the motion's torque; ``fast``: unfiltered."""
    drive, robot = states[0].servos, states[0].robot
    inertia = np.mean(np.concatenate([s.own_inertia for s in states]), axis=0) + robot.column("rotor_inertia")
    resolution = np.max([s.moved.resolution for s in states], axis=0)
    return noise_of(drive.servo.stiffness, drive.servo.damping, inertia, resolution, drive.step, fast)


def _between_ends(run: Run) -> NDArray[np.bool_]:
    """(N, 1) true where the filter of a driven run has samples both before and after."""
    inside = np.ones((len(run.time), 1), np.bool_)
    if run.drive is not None:
        edge = round(EDGE / run.step)
        inside[:edge] = inside[len(inside) - edge :] = False
    return inside


def _without_gaps(variance: Float, run: Run) -> Float:
    """Variance in which samples that were filled in have no weight."""
    return np.where(run.filled[:, None], FILLED_VARIANCE * variance, variance)
