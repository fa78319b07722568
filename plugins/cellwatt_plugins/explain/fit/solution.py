"""Result of a search: terms, their fit, and what was tried."""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field, replace

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.problem import Place, Problem, Term
from cellwatt_plugins.robot.blocks import Block, Regression


@dataclass(frozen=True)
class Trial:
    """A candidate that was tried, and why it was accepted or rejected."""

    effect: str
    joint: int | None
    gain: float
    """Log evidence that it adds, nats."""
    kept: bool
    why: str

    @classmethod
    def of(cls, term: Term, gain: float, kept: bool, why: str) -> Trial:
        """The trial of a term, its joint counted from 1."""
        return cls(term.effect.name, term.number, float(gain), kept, why)


@dataclass(frozen=True)
class Candidate:
    """A term with the evidence (nats) that it would add."""

    term: Term
    gain: float


@dataclass
class Solution:
    """The terms found, their fit, and the candidates tried."""

    problem: Problem
    terms: list[Term]
    fit: Regression
    factor: Float
    tried: list[Trial] = field(default_factory=list)
    spent: bool = False
    """True if the time limit was reached before all candidates were tried."""
    unsearched: tuple[int, ...] = ()
    """Joints (0-based) whose candidates were not all tried with these terms before the time limit."""
    free: Problem | None = None
    """The problem with all nominal parameters free, before those that data left out do not confirm were fixed."""
    curved: Solution | None = None
    """The same terms with curves of the residual, if data left out confirm any."""
    rivals: dict[Place, tuple[float, tuple[Candidate, ...]]] = field(default_factory=dict)
    """Evidence of each term with the others present, and of the best other names in its place."""

    @property
    def best(self) -> Solution:
        """The solution with curves if there are any, otherwise this one."""
        return self if self.curved is None else self.curved

    @property
    def residual(self) -> Float:
        """Residual (N, C)."""
        return self.fit.residual

    def with_coefficients(self, coefficients: Float) -> Solution:
        """The same terms with other coefficients (P,), e.g. those of a fit without some of the data."""
        fit = copy(self.fit)
        fit.coefficients = coefficients
        return replace(self, fit=fit)

    def block(self, term: Term) -> tuple[Block, slice]:
        """The block of a term in the fit and the slice of its coefficients."""
        at = self.terms.index(term)
        return self.fit.blocks[at], self.fit.slices[at]

    def coefficients(self, term: Term) -> Float:
        """The coefficients (m,) of a term in the fit."""
        return np.asarray(self.fit.coefficients[self.block(term)[1]])

    def added(self, term: Term) -> Float:
        """Contribution (N, C) of a fitted term to the channels."""
        return self.block(term)[0].times(self.coefficients(term), len(self.problem.floor))
