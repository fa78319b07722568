"""Expected evidence of an experiment: the log evidence that recordings and experiment together would hold.

The experiment's torque (or power) is foretold by what the recordings say under one name; the other name, nominal
parameters within their tolerances and all other terms then try to fit recordings and experiment alike. What they
fail to fit is the noncentrality ‖(I - P)(f₁ - f₂)‖²/σ² of Box and Hill (Discrimination among mechanistic models,
Technometrics 1967), here as the difference of log evidence that ``explain`` itself would find.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.mismatch.fit.nuisance import supply_nuisance, torque_nuisance
from cellwatt_plugins.mismatch.fit.problem import STOP, Problem, Term
from cellwatt_plugins.mismatch.fit.solution import Solution
from cellwatt_plugins.robot.blocks import Block, Design, Regression
from cellwatt_plugins.robot.effects import BY_NAME
from cellwatt_plugins.robot.effects.effect import Shape
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.regression import Prior

Float = NDArray[np.float64]

ROWS = 5000
"""Rows of the recordings that are looked at, about."""
PLAIN_FRICTION = ("coulomb_friction", "viscous_friction")


class ExpectedEvidence:
    """One side's recordings and, behind them, an experiment's ``states`` (None: the recordings alone)."""

    def __init__(self, solution: Solution, states: States | None) -> None:
        self.solution, self.problem, self.states = solution, solution.problem, states
        design = self.problem.design
        # A row in so many counts for those between: the evidence is the same, the work is not.
        self._every = max(1, len(design.target) // ROWS)
        self._variance = 1 / design.root[:: self._every] ** 2 / self._every
        self._blocks = tuple(replace(b, columns=b.columns[:: self._every]) for b in design.blocks)
        self._new: tuple[Block, ...] = ()
        self._fits: dict[int | None, Regression] = {}
        if states is None:
            return
        nuisance = torque_nuisance if self.problem.side == "torque" else supply_nuisance
        known = nuisance([states])
        # Of what a simulation has beyond the description, nothing is foretold for another motion.
        more = (replace(b, columns=np.zeros((len(states.time), b.size))) for b in design.blocks[len(known) :])
        self._new = (*known, *more)
        self._variance = np.concatenate([self._variance, _variance(solution, states)])
        pairs = zip(self._blocks, self._new, strict=True)
        self._blocks = tuple(replace(b, columns=np.concatenate([b.columns, new.columns])) for b, new in pairs)

    def block(self, term: Term) -> Block:
        """The columns of a term in recordings and experiment."""
        block = self.problem.block(term)
        columns = block.columns[:: self._every]
        if self.states is not None:
            columns = np.concatenate([columns, term.effect.columns(self.states, term.joint, term.shape)])
        return replace(block, columns=columns)

    def regression(self, truth: Sequence[Term], terms: Sequence[Term], factor: Float) -> Regression:
        """Fit of ``terms`` where the experiment turns out as ``truth``, fitted to the recordings, foretells.

        ``factor`` (C,) is the correlation factor of the residual.
        """
        return Regression(self._design(truth), [self.block(t) for t in terms], factor)

    def _design(self, truth: Sequence[Term]) -> Design:
        target = self.problem.design.target[:: self._every]
        if self.states is not None:
            target = np.concatenate([target, self._foretold(truth, self.states)])
        return Design(target, self._variance, self._blocks)

    def _foretold(self, truth: Sequence[Term], states: States) -> Float:
        """Torque or power (M, C) that the experiment adds to the nominal law if the terms in ``truth`` are right."""
        known = [self.problem.block(t) for t in truth]
        fit = self.problem.fit(known, self.solution.factor)
        own = [
            replace(b, columns=t.effect.columns(states, t.joint, t.shape)) for b, t in zip(known, truth, strict=True)
        ]
        out = np.zeros((len(states.time), len(self.problem.floor)))
        for block, place in zip((*self._new, *own), (*self.problem.design.slices, *fit.slices), strict=True):
            out += block.times(fit.coefficients[place], out.shape[1])
        return out

    def lead(self, term: Term, rival: Term) -> float:
        """Log evidence (nats) by which a term leads its rival if it is the true one; both take their best shapes.

        As in the search, the residual without either says how much a sample counts.
        """
        others = [t for t in self.solution.terms if t.place != term.place and t.place != rival.place]
        fit = self.regression([*others, term], others, self._factor(others))
        return self._best(fit, term) - self._best(fit, rival)

    def _factor(self, terms: Sequence[Term]) -> Float:
        """Correlation factor (C,) of what ``terms`` leave of the recordings, which counts as noise."""
        factor, blocks = self.solution.factor, [self.problem.block(t) for t in terms]
        for _ in range(3):
            factor = self.problem.noise_factor(self.problem.fit(blocks, factor).residual)
        return factor

    def _best(self, fit: Regression, term: Term) -> float:
        blocks = [self.block(replace(term, shape=shape)) for shape in self._shapes(term)]
        allowed = [
            gain
            for gain, found in fit.gains(blocks)
            if not (term.effect.acceptance.above is not None and found[0] <= 0)
        ]
        return max([0.0, *allowed])

    def _shapes(self, term: Term) -> list[Shape]:
        """The term's own shape, and all that are quickly tried."""
        if term.effect.depends_on in ("fitted torque", "residual") or term.effect.form.sample_by_sample:
            return [term.shape]
        residual = self.problem.every_sample(self.solution.residual)
        return [term.shape, *term.effect.shapes(self.problem.states, term.joint, residual)]

    def against(self, term: Term, size: Float) -> float:
        """Log evidence (nats) that speaks against a term with coefficients ``size`` (m,) where it is not there.

        Coulomb and viscous friction of that joint may be off by any amount.
        """
        certain = np.diag(np.full(len(size), np.square(1e-3 * np.max(np.abs(size)))))
        return -self._as_found(term).gain(replace(self.block(term), prior=Prior(size, certain)))[0]

    def _as_found(self, beside: Term) -> Regression:
        """Fit of the terms found, and of plain friction beside a term, where the experiment turns out as found."""
        place = None if beside.effect.name in PLAIN_FRICTION else beside.joint
        if place not in self._fits:
            found = self.solution.terms
            plain = [] if place is None else [Term(BY_NAME[name], place, ()) for name in PLAIN_FRICTION]
            blocks = [self.block(t) for t in [*found, *(t for t in plain if t.place not in {f.place for f in found})]]
            self._fits[place] = Regression(self._found, blocks, self.solution.factor)
        return self._fits[place]

    @cached_property
    def _found(self) -> Design:
        return self._design(self.solution.terms)


def _variance(solution: Solution, states: States) -> Float:
    """Variance (M, C) of an experiment's samples; its rows count by the time that they stand for."""
    problem = solution.problem
    recorded = problem.rows[0].step
    variance = np.broadcast_to(np.square(problem.floor), (len(states.time), len(problem.floor)))
    if problem.side == "torque":
        turning = states.arm.column("coulomb_friction") + _turning(solution, problem)
        unsure = np.square(states.turning.spread) + np.square(states.turning.held)
        variance = variance + np.square(turning) * unsure * max(1.0, STOP / recorded)
    return np.asarray(variance * recorded / states.step)


def _turning(solution: Solution, problem: Problem) -> Float:
    """Friction (C,) Nm that the terms add and that turns over with the velocity's sign."""
    out = np.zeros(len(problem.floor))
    for term in solution.terms:
        if term.effect.form.reverses and term.joint is not None:
            out[term.joint] += abs(float(solution.fit.coefficients[solution.block(term)[1]][0]))
    return out
