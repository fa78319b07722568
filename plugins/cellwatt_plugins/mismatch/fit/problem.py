"""One side of the arm as a regression: torques of the joints, or power of the supply, beside their nominal law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, uniform_filter1d

from cellwatt.arrays import Float
from cellwatt_plugins.mismatch.fit.holding import held_at_rest
from cellwatt_plugins.mismatch.fit.metering import Metering
from cellwatt_plugins.mismatch.fit.noise import correlation_factor, floor, step_noise
from cellwatt_plugins.mismatch.fit.nuisance import supply_nuisance, torque_nuisance
from cellwatt_plugins.mismatch.fit.rows import Filtered, Rows, Thinned
from cellwatt_plugins.mismatch.input.run import Run
from cellwatt_plugins.robot.blocks import Block, Design, Regression
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.effects.effect import Effect, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import smooth
from cellwatt_plugins.robot.regression import Prior
from cellwatt_plugins.robot.servo.filtered import EDGE, compared
from cellwatt_plugins.robot.servo.filtered import noise as noise_of

ROWS = 16000
"""Rows that are fitted, about."""
LEAST_RATE = 12.0
"""Hz that are fitted at least."""
SLOW = 0.3
"""s over which the slow part of a residual is averaged."""
FINEST = 0.002
"""Share of what was measured that a noise floor is at least: no law of an arm is finer, however quiet its sensors."""
LAWS = 0.005
"""The same where the law of a servo stands for what was measured."""
MOVES = 0.05
"""rad: a joint that goes further has moved."""
UNTOLD = 1e12
"""Variance of a torque that is not known, in units of the noise's."""
MADE = 300
"""Blocks that are remembered."""
ROWS_PERIOD = 3.0
"""Rows that are fitted in a period of the fastest that is compared."""
LEAK = 0.15
"""Share of a joint's rattling, too fast to be compared, that may come back as something slow: a drive clips it."""
RATTLES = 3.0
"""Torque too fast to be compared from which a joint rattles, in units of what counts as considerable there."""
STOP = 0.1
"""s over which the sign of the velocity stays unknown at a stop."""


@dataclass(frozen=True)
class Term:
    """An effect at a place with its shape."""

    effect: Effect
    joint: int | None
    """0-based; None for the robot or the supply."""
    shape: Shape

    @property
    def place(self) -> tuple[str, int | None]:
        """Effect and joint, which tell it from other terms."""
        return self.effect.name, self.joint


def on_joints(course: Float, joint: int | None, joints: int) -> Float:
    """A course (N,) of one joint beside zeros of the others, (N, n); one (N, n) of the whole arm as it is."""
    if course.ndim == 2:
        return course
    out = np.zeros((len(course), joints))
    out[:, joint or 0] = course
    return out


def said(term: Term) -> str:
    """Name of a term in messages."""
    name = term.effect.name.replace("_", " ")
    return name if term.joint is None else f"{name} of joint {term.joint + 1}"


@dataclass(frozen=True)
class Problem:
    """Measured minus nominal (N, C) of all runs, its variance and the nominal parameters that may be off."""

    side: str
    """``torque`` or ``supply``."""
    states: tuple[States, ...]
    rows: tuple[Rows, ...]
    """Rows of each run that are fitted; states are simulated at all samples."""
    target: tuple[Float, ...]
    variance: tuple[Float, ...]
    """(M, C) of each run's rows."""
    floor: Float
    """Noise floor (C,)."""
    size: Float
    """Size (C,) that counts as considerable: scale of the priors of effects."""
    nuisance: tuple[Block, ...]
    measured: Float
    """Standard deviation (C,) of what was measured."""

    simulated: dict[tuple[object, ...], list[Float]] = field(default_factory=dict)
    """Columns of terms that depend on the motion alone."""
    made: dict[tuple[object, ...], Block] = field(default_factory=dict)
    """Blocks of such terms."""
    of_design: dict[str, Any] = field(default_factory=dict)
    """What ``LeaveOut`` makes once of the design, which stays whatever torque is fitted."""

    def stack(self, parts: Sequence[Float]) -> Float:
        """One array (each run's samples, …) per run to the fitted rows of all runs."""
        return np.concatenate([rows.of(part) for rows, part in zip(self.rows, parts, strict=True)])

    def split(self, stacked: Float) -> list[Float]:
        """Fitted rows of all runs back to each run."""
        ends = np.cumsum([len(part) for part in self.target])[:-1]
        return np.split(stacked, ends)

    def every_sample(self, stacked: Float) -> list[Float]:
        """Fitted rows (N, C) back to all samples of each run, interpolated between them."""
        return [rows.samples(part) for rows, part in zip(self.rows, self.split(stacked), strict=True)]

    def block(self, term: Term) -> Block:
        """The columns of a term over all runs, with their prior; made once where they depend on the motion alone."""
        if not term.effect.by_motion_alone:
            return self.prior_block(term, self.stack(self.columns(term)))
        key = (*term.place, term.shape)
        if key not in self.made:
            if len(self.made) > MADE:
                self.made.clear()
            self.made[key] = self.prior_block(term, self.stack(self.columns(term)))
        return self.made[key]

    def columns(self, term: Term) -> list[Float]:
        """Columns of a term in each run; simulated once where they depend on the motion alone."""
        if term.effect.acts_on == "supply" or term.effect.depends_on in ("load", "fitted torque"):
            return [term.effect.columns(s, term.joint, term.shape) for s in self.states]
        key = (*term.place, term.shape)
        if key not in self.simulated:
            self.simulated[key] = [term.effect.columns(s, term.joint, term.shape) for s in self.states]
        return self.simulated[key]

    def prior_block(self, term: Term, columns: Float) -> Block:
        """Columns as a block with the effect's prior."""
        prior = term.effect.prior(self.states, term.joint, columns, self.size)
        channel = None if columns.ndim == 3 else (term.joint or 0)
        return Block(columns, channel, prior)

    @cached_property
    def told(self) -> list[int]:
        """Channels (0-based) of which anything was measured."""
        least = np.min([np.min(part, axis=0) for part in self.variance], axis=0)
        return [int(c) for c in np.flatnonzero(least < UNTOLD * self.floor**2)]

    @cached_property
    def design(self) -> Design:
        """Target and nominal parameters of all runs, ready to be fitted."""
        blocks = [Block(self.stack(np.split(b.columns, self._ends)), b.channel, b.prior) for b in self.nuisance]
        return Design(np.concatenate(self.target), np.concatenate(self.variance), blocks)

    def channel(self, index: int) -> tuple[str, str]:
        """Name and unit: ``tau_3`` and ``N*m``, or ``N``, of the third joint; ``power`` and ``W`` of the supply."""
        if self.side == "supply":
            return "power", "W"
        return f"tau_{index + 1}", self.states[0].robot.unit(index, "N*m")

    @property
    def _ends(self) -> NDArray[np.intp]:
        return np.cumsum([len(states.time) for states in self.states])[:-1]

    def course(self, nuisance: Float, terms: Sequence[tuple[Term, Float]]) -> tuple[list[Float], list[Float]]:
        """Torque (N, n) of each run at all samples, and what of it the links need beyond the nominal.

        It is the nominal law, nominal parameters off by ``nuisance``, and terms.
        """
        joints = self.states[0].arm.body.joints
        carried = [s.regressor @ nuisance[: PER_LINK * joints] for s in self.states]
        out = [s.nominal + load for s, load in zip(self.states, carried, strict=True)]
        last = len(self.nuisance) - (0 if self.states[0].drive is None else joints)
        for block, place in zip(self.nuisance[joints:last], self.design.slices[joints:last], strict=True):
            for part, columns in zip(out, np.split(block.columns, self._ends), strict=True):
                part[:, block.channel or 0] += columns @ nuisance[place]
        for term, coefficients in terms:
            for part, load, columns in zip(out, carried, self.columns(term), strict=True):
                more = columns @ coefficients
                if columns.ndim == 3:
                    part += more
                    load += more if term.effect.acts_on == "links" else 0.0
                else:
                    part[:, term.joint or 0] += more
        return out, carried

    def fit(self, blocks: Sequence[Block], factor: Float | None = None) -> Regression:
        """Nuisance and ``blocks`` together; ``factor`` (C,) is the correlation factor of the residual."""
        return Regression(self.design, blocks, np.full(len(self.floor), 2.0) if factor is None else factor)

    def factor(self, residual: Float) -> Float:
        """Correlation factor (C,) of a residual (N, C)."""
        return correlation_factor(self.split(residual * self.design.root), [rows.step for rows in self.rows])

    def noise_factor(self, residual: Float) -> Float:
        """Correlation factor (C,) of a residual (N, C); what is unexplained yet counts as noise.

        So an effect is judged by the share that it explains.
        """
        return self.factor(residual) * np.maximum(self.scale(residual), 1.0)

    def scale(self, residual: Float) -> Float:
        """Mean square (C,) of a residual (N, C) in units of its variance, by the samples' weights in the fit."""
        return np.asarray(np.mean(np.square(residual * self.design.root), axis=0))

    def chi2(self, residual: Float) -> Float:
        """Mean square (C,) of a residual (N, C) in units of its variance: 1 is noise.

        Near stops, where friction may pull either way, samples count less; without a plan every sample is in doubt.
        """
        if any(s.unplanned for s in self.states):
            return self.scale(residual)
        weight = np.square(self.design.root)
        return np.asarray(np.sum(np.square(weight * residual), axis=0) / np.sum(weight, axis=0))

    def rms(self, residual: Float) -> Float:
        """Rms (C,) of a residual (N, C); near stops, where friction may pull either way, samples count less."""
        weight = np.square(self.design.root)
        return np.asarray(np.sqrt(np.sum(weight * np.square(residual), axis=0) / np.sum(weight, axis=0)))

    def fast_chi2(self, residual: Float) -> Float:
        """The same of what is faster than ``SLOW``: a spring rings and a gap clacks, friction does not."""
        parts = []
        for rows, part in zip(self.rows, self.split(residual * self.design.root), strict=True):
            width = max(3, round(SLOW / rows.step))
            parts.append((part - uniform_filter1d(part, width, axis=0)) / np.sqrt(1 - 1 / width))
        return self.chi2(np.concatenate(parts) / self.design.root)

    def with_torque(self, torque: Sequence[Float], carried: Sequence[Float]) -> Problem:
        """The same problem for effects that see another fitted torque, and what the links need beyond the nominal."""
        triples = zip(self.states, torque, carried, strict=True)
        new = replace(self, states=tuple(s.with_torque(t, c) for s, t, c in triples))
        new.__dict__["design"] = self.design
        return new

    def with_priors(self, priors: Sequence[Prior]) -> Problem:
        """The same problem where the nominal parameters have other priors."""
        nuisance = tuple(replace(block, prior=prior) for block, prior in zip(self.nuisance, priors, strict=True))
        new = replace(self, nuisance=nuisance)
        new.__dict__["design"] = self.design.with_priors(priors)
        return new


def torque_problem(
    runs: Sequence[Run], states: Sequence[States], turning: Float | None = None, late: float = 0.0
) -> Problem:
    """The joints' torques of all runs.

    ``turning`` (n,) Nm is friction beyond the nominal that turns over with the sign of the velocity: the less is known
    of that sign, the less a sample counts. What the motion leaves unsure shows in the torque within ``late`` s.
    """
    robot = states[0].robot
    told = _told(runs, states)
    target = tuple(
        np.where(there, run.torque - s.nominal, 0.0) for run, s, there in zip(runs, states, told, strict=True)
    )
    measured = np.concatenate([np.where(there, run.torque, np.nan) for run, there in zip(runs, told, strict=True)])
    silent = ~np.concatenate(told).any(axis=0)
    measured[:, silent] = 0.0
    spread = np.where(silent, 1.0, np.nanstd(measured, axis=0))
    drive = states[0].drive
    finest = np.maximum((FINEST if drive is None else LAWS) * spread, step_noise(measured))
    quiet = floor(target, [run.step for run in runs]) if drive is None else encoder_floor(states)
    noise = np.where(silent, 1.0, np.maximum(quiet, finest))
    least = 0.03 * spread
    coulomb = np.maximum(robot.column("coulomb_friction"), least) + (0.0 if turning is None else turning)
    at_rest = held_at_rest(states, target, noise) / coulomb
    # An unknown sign near a stop is wrong for the whole stop: its samples are one draw, not many.
    variance = tuple(
        noise**2
        + _until(
            np.square(coulomb) * _unsure(s, at_rest) * max(1.0, STOP / run.step)
            + np.square((s.own_inertia + robot.column("rotor_inertia")) * s.moved.acceleration_spread),
            round(late / run.step),
        )
        for run, s in zip(runs, states, strict=True)
    )
    variance = tuple(
        np.where(there & _between_ends(run), _without_gaps(v, run), UNTOLD * noise**2)
        for v, run, there in zip(variance, runs, told, strict=True)
    )
    size = np.maximum(robot.column("coulomb_friction"), 0.1 * spread)
    rows: tuple[Thinned, ...] = thinned(runs)
    if drive is not None:
        rows = kept = filtered(runs)
        least = np.hypot(size, encoder_floor(states, fast=True))
        variance = tuple(v + rattling(part, r, least) for v, part, r in zip(variance, target, kept, strict=True))
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
    """Variance (N, n) Nm² of what a joint that rattles leaves in the slow part of a run's target (N, n) Nm.

    ``least`` (n,) Nm is what a reversal's friction and the encoders' noise are, which is no rattling.
    """
    fast = target - smooth(target, rows.sample_step, rows.bandwidth)
    power = uniform_filter1d(np.square(fast), max(1, round(EDGE / rows.sample_step)), axis=0)
    return np.asarray(np.where(power > np.square(RATTLES * least), np.square(LEAK) * power, 0.0))


def _until(values: Float, rows: int) -> Float:
    """The greatest of values (N, n) over so many rows before each, or after it where ``rows`` is negative."""
    if rows < 0:
        return _until(values[::-1], -rows)[::-1]
    return np.asarray(maximum_filter1d(values, rows + 1, axis=0, origin=rows // 2))


def _unsure(states: States, at_rest: Float) -> Float:
    """Variance (N, n) of friction in units of Coulomb's squared: of its sign, and of what holds the arm.

    ``at_rest`` (n,) is the share of Coulomb friction that was seen to hold it at rest.
    """
    turning = states.turning
    return np.square(turning.spread) + np.square(np.where(states.resting, np.minimum(at_rest, 1.0), turning.held))


def _told(runs: Sequence[Run], states: Sequence[States]) -> list[NDArray[np.bool_]]:
    """(N, n) of each run: true where a torque was read of a joint that moves, if only in another run.

    At rest friction holds any torque: what a joint that never moves shows is no evidence.
    """
    moves = np.max([np.ptp(s.q, axis=0) for s in states], axis=0) > MOVES
    return [np.isfinite(run.torque) & moves for run in runs]


def supply_problem(
    runs: Sequence[Run], states: Sequence[States], doubt: Sequence[Float], meter: Metering | None = None
) -> Problem | None:
    """The supply's power of the runs that have it; None where no run has power.

    States carry the torque that moves the arm, known to within ``doubt`` (N, n) Nm. What a slow ``meter`` showed is
    compared with the mean over the time that it stands for.
    """
    kept = [(i, run.power) for i, run in enumerate(runs) if run.power is not None]
    if not kept:
        return None
    chosen = tuple(states[i] for i, _ in kept)
    rows: tuple[Rows, ...]
    shown: Sequence[Float]
    if meter is None:
        rows, shown = thinned([runs[i] for i, _ in kept]), [power for _, power in kept]
        target = [(power - s.nominal_power)[:, None] for power, s in zip(shown, chosen, strict=True)]
        noise = floor(target, [runs[i].step for i, _ in kept])
        target = [r.of(part) for r, part in zip(rows, target, strict=True)]
    else:
        rows, shown = meter.rows, meter.values
        target = [(power - r.of(s.nominal_power))[:, None] for power, r, s in zip(shown, rows, chosen, strict=True)]
        noise = floor(target, [r.step for r in rows])
    variance = []
    for (i, _), r, s in zip(kept, rows, chosen, strict=True):
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


def thinned(runs: Sequence[Run]) -> tuple[Thinned, ...]:
    """Every so many samples, so that about ``ROWS`` are fitted, at ``LEAST_RATE`` or more."""
    most = sum(len(run.time) for run in runs) / ROWS
    every = max(1, min(round(most), int(1 / (runs[0].step * LEAST_RATE))))
    return tuple(Thinned(len(run.time), every, run.step) for run in runs)


def filtered(runs: Sequence[Run]) -> tuple[Filtered, ...]:
    """What is slow enough to be compared of runs whose torque is that of their servos' law."""
    out = []
    for run in runs:
        bandwidth = compared(run.step)
        every = max(1, int(1 / (ROWS_PERIOD * bandwidth * run.step)))
        out.append(Filtered(len(run.time), every, run.step, bandwidth))
    return tuple(out)


def encoder_floor(states: Sequence[States], fast: bool = False) -> Float:
    """Noise (n,) Nm of the servos' law less the motion's torque, by the encoders alone: of what is compared, or all."""
    drive, robot = states[0].servos, states[0].robot
    inertia = np.mean(np.concatenate([s.own_inertia for s in states]), axis=0) + robot.column("rotor_inertia")
    resolution = np.max([s.moved.resolution for s in states], axis=0)
    return noise_of(drive.servo.stiffness, drive.servo.damping, inertia, resolution, drive.step, fast)


def _between_ends(run: Run) -> NDArray[np.bool_]:
    """(N, 1) true where the filter of a driven run knows what was before and after."""
    inside = np.ones((len(run.time), 1), np.bool_)
    if run.drive is not None:
        edge = round(EDGE / run.step)
        inside[:edge] = inside[len(inside) - edge :] = False
    return inside


def _without_gaps(variance: Float, run: Run) -> Float:
    """Samples that were filled in count for nothing."""
    return np.where(run.filled[:, None], 1e6 * variance, variance)
