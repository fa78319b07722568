"""One side of the arm as a regression: torques of the joints, or power of the supply, beside their nominal law."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from cellwatt.arrays import Bool, Float
from cellwatt_plugins.explain.fit.noise import correlation_factor
from cellwatt_plugins.explain.fit.nuisance import Nominal
from cellwatt_plugins.explain.fit.rows import Rows
from cellwatt_plugins.robot.blocks import Block, Design, Regression
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.effects.effect import Effect, Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.regression import Prior

SLOW = 0.3
"""s over which the slow part of a residual is averaged."""
UNKNOWN_VARIANCE = 1e12
"""Variance of an unknown torque, in units of the noise's variance."""
FILLED_VARIANCE = 1e10
"""Factor on the variance of a sample that was filled in: more than that of any sample near a stop."""
MADE = 300
"""Largest number of cached blocks."""

Place = tuple[str, int | None]
"""Name of an effect or a nominal parameter, and its joint (0-based); None for the robot or the supply."""


@dataclass(frozen=True)
class Term:
    """An effect at a joint, the robot or the supply, with its shape."""

    effect: Effect
    joint: int | None
    """0-based; None for the robot or the supply."""
    shape: Shape

    @property
    def place(self) -> Place:
        """Effect and joint, which identify the term."""
        return self.effect.name, self.joint

    @property
    def number(self) -> int | None:
        """The joint, counted from 1."""
        return None if self.joint is None else self.joint + 1

    def columns(self, states: States) -> Float:
        """Its columns along one run; see ``Effect.acting``."""
        return self.effect.acting(states, self.joint, self.shape)


def on_joints(course: Float, joint: int | None, joints: int) -> Float:
    """(N, n): the course (N,) of one joint with zeros for the others; a course (N, n) of the whole arm is unchanged."""
    if course.ndim == 2:
        return course
    out = np.zeros((len(course), joints))
    out[:, joint or 0] = course
    return out


def title(term: Term) -> str:
    """Name of a term in messages."""
    name = term.effect.name.replace("_", " ")
    return name if term.joint is None else f"{name} of joint {term.number}"


@dataclass(frozen=True)
class Problem:
    """Measured minus nominal (N, C) of all runs, its variance and the nominal parameters that may be off."""

    side: str
    """``torque`` or ``supply``."""
    states: tuple[States, ...]
    rows: tuple[Rows, ...]
    """Fitted rows of each run; states are simulated at all samples."""
    target: tuple[Float, ...]
    variance: tuple[Float, ...]
    """(M, C) of each run's rows."""
    floor: Float
    """Noise floor (C,)."""
    size: Float
    """Size (C,) of a considerable value, in the channel's unit: scale of the priors of effects."""
    nuisance: tuple[Nominal, ...]
    measured: Float
    """Standard deviation (C,) of the measured values."""

    simulated: dict[tuple[object, ...], list[Float]] = field(default_factory=dict)
    """Columns of terms that depend on the motion alone."""
    made: dict[tuple[object, ...], Block] = field(default_factory=dict)
    """Blocks of such terms."""
    of_design: dict[str, Any] = field(default_factory=dict)
    """Products that ``LeaveOut`` computes once per design; the design is the same for every fitted torque."""

    def stack(self, parts: Sequence[Float]) -> Float:
        """Concatenate one array (samples, …) per run into the fitted rows of all runs."""
        return np.concatenate([rows.of(part) for rows, part in zip(self.rows, parts, strict=True)])

    def split(self, stacked: Float) -> list[Float]:
        """Split the fitted rows of all runs into the rows of each run."""
        ends = np.cumsum([len(part) for part in self.target])[:-1]
        return np.split(stacked, ends)

    def every_sample(self, stacked: Float) -> list[Float]:
        """Interpolate the fitted rows (N, C) to all samples of each run."""
        return [rows.samples(part) for rows, part in zip(self.rows, self.split(stacked), strict=True)]

    def block(self, term: Term) -> Block:
        """The columns of a term over all runs, with their prior; cached if they depend on the motion alone."""
        if not term.effect.by_motion_alone:
            return self.prior_block(term, self.stack(self.columns(term)))
        key = (*term.place, term.shape)
        if key not in self.made:
            if len(self.made) > MADE:
                self.made.clear()
            # Not by ``columns``, which would store each shape that is tried at all samples.
            self.made[key] = self.prior_block(term, self.stack([term.columns(s) for s in self.states]))
        return self.made[key]

    def columns(self, term: Term) -> list[Float]:
        """Columns of a term in each run; simulated once if they depend on the motion alone."""
        if term.effect.acts_on == "supply" or term.effect.depends_on in ("load", "fitted torque"):
            return [term.columns(s) for s in self.states]
        key = (*term.place, term.shape)
        if key not in self.simulated:
            self.simulated[key] = [term.columns(s) for s in self.states]
        return self.simulated[key]

    def torques(self, term: Term, coefficients: Float) -> list[Float]:
        """Torque (N, n) Nm of a term in each run."""
        joints = self.states[0].arm.body.joints
        return [on_joints(columns @ coefficients, term.joint, joints) for columns in self.columns(term)]

    def prior_block(self, term: Term, columns: Float) -> Block:
        """Columns as a block with the effect's prior."""
        prior = term.effect.prior(self.states, term.joint, columns, self.size)
        channel = None if columns.ndim == 3 else (term.joint or 0)
        return Block(columns, channel, prior)

    @cached_property
    def observed(self) -> list[int]:
        """Channels (0-based) with any measured values; the supply has one channel."""
        if self.side == "supply":
            return [0]
        least = np.min([np.min(part, axis=0) for part in self.variance], axis=0)
        return [int(c) for c in np.flatnonzero(least < UNKNOWN_VARIANCE * self.floor**2)]

    @cached_property
    def design(self) -> Design:
        """Target and nominal parameters of all runs, prepared for fitting."""
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
        """Torque (N, n) Nm of each run at all samples, and the links' contribution to it beyond the nominal.

        It is the sum of the nominal law, the nominal parameters' corrections ``nuisance``, and terms.
        """
        joints = self.states[0].arm.body.joints
        carried = [s.regressor @ nuisance[: PER_LINK * joints] for s in self.states]
        out = [s.nominal + load for s, load in zip(self.states, carried, strict=True)]
        for block, place in zip(self.nuisance, self.design.slices, strict=True):
            if block.name in ("link", "drive"):
                continue
            for part, columns in zip(out, np.split(block.columns, self._ends), strict=True):
                part += on_joints(columns @ nuisance[place], block.channel, joints)
        for term, coefficients in terms:
            for part, load, more in zip(out, carried, self.torques(term, coefficients), strict=True):
                part += more
                load += more if term.effect.acts_on == "links" else 0.0
        return out, carried

    def fit(self, blocks: Sequence[Block], factor: Float | None = None) -> Regression:
        """Fit nuisance and ``blocks`` together; ``factor`` (C,) is the correlation factor of the residual."""
        return Regression(self.design, blocks, np.full(len(self.floor), 2.0) if factor is None else factor)

    def factor(self, residual: Float) -> Float:
        """Correlation factor (C,) of a residual (N, C)."""
        return correlation_factor(self.split(residual * self.design.root), [rows.step for rows in self.rows])

    def noise_factor(self, residual: Float) -> Float:
        """Correlation factor (C,) of a residual (N, C) in which any unexplained residual counts as noise.

        So an effect is judged by the share that it explains.
        """
        return self.factor(residual) * np.maximum(self.scale(residual), 1.0)

    def scale(self, residual: Float) -> Float:
        """Mean square (C,) of a residual (N, C) in units of its variance, by the samples' weights in the fit."""
        return np.asarray(np.mean(np.square(residual * self.design.root), axis=0))

    def chi2(self, residual: Float) -> Float:
        """Mean square (C,) of a residual (N, C) in units of its variance: 1 is noise.

        Samples near stops, where friction may pull either way, count less; without a plan every sample is uncertain.
        """
        if any(s.unplanned for s in self.states):
            return self.scale(residual)
        weight = np.square(self.design.root)
        return np.asarray(np.sum(np.square(weight * residual), axis=0) / np.sum(weight, axis=0))

    def rms(self, residual: Float) -> Float:
        """Rms (C,) of a residual (N, C); samples near stops, where friction may pull either way, count less."""
        weight = np.square(self.design.root)
        return np.asarray(np.sqrt(np.sum(weight * np.square(residual), axis=0) / np.sum(weight, axis=0)))

    @property
    def recorded(self) -> Bool:
        """(N, C) true where a sample was measured, false where it was filled in."""
        return np.asarray(self.floor * self.design.root > 1.01 * FILLED_VARIANCE**-0.5)

    def fast_chi2(self, residual: Float) -> Float:
        """``chi2`` of the part of a residual faster than ``SLOW``: a spring rings, a gap clacks, friction does not."""
        parts = []
        for rows, part in zip(self.rows, self.split(residual * self.design.root), strict=True):
            width = max(3, round(SLOW / rows.step))
            parts.append((part - uniform_filter1d(part, width, axis=0)) / np.sqrt(1 - 1 / width))
        return self.chi2(np.concatenate(parts) / self.design.root)

    def with_torque(self, torque: Sequence[Float], carried: Sequence[Float]) -> Problem:
        """The same problem with another fitted torque, and links' torque beyond the nominal, for effects that use
        them."""
        triples = zip(self.states, torque, carried, strict=True)
        new = replace(self, states=tuple(s.with_torque(t, c) for s, t, c in triples))
        new.__dict__["design"] = self.design
        return new

    def with_priors(self, priors: Sequence[Prior]) -> Problem:
        """The same problem with other priors of the nominal parameters."""
        nuisance = tuple(replace(block, prior=prior) for block, prior in zip(self.nuisance, priors, strict=True))
        new = replace(self, nuisance=nuisance)
        new.__dict__["design"] = self.design.with_priors(priors)
        return new
