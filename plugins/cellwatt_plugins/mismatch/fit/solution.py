"""Result of a search: terms, their fit, and what was tried; and the thresholds of acceptance."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.mismatch.fit.problem import Problem, Term
from cellwatt_plugins.robot.blocks import Block, Regression

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Thresholds:
    """Thresholds at which a term is accepted."""

    gain: float = 16.0
    """Log evidence (nats) that it must add; about 150 names are tried, chance adds 5."""
    share: float = 0.05
    """Share of what is unexplained in its channels that it must explain."""
    least: float = 0.004
    """Share of the whole residual of its channels that it must explain."""
    held_out: float = 0.015
    """Share by which it must lower the error on data left out of a channel that is far from its noise."""
    blur: float = 4.0
    """Factor on another term's standard deviation from which the two cannot be told apart."""
    credible: float = 0.6
    """Share of all that differs at its joint that it must explain where much stays unexplained."""
    costly: float = 1.3
    """Mean square of the residual's fast part, in units of the noise, from which costly effects are tried."""
    most: int = 40
    """Terms at most."""


DEFAULT = Thresholds()


@dataclass(frozen=True)
class Trial:
    """A candidate that was tried: why it was kept or refused."""

    effect: str
    joint: int | None
    gain: float
    """Log evidence that it adds, nats."""
    kept: bool
    why: str

    @classmethod
    def of(cls, term: Term, gain: float, kept: bool, why: str) -> Trial:
        """The trial of a term, its joint counted from 1."""
        return cls(term.effect.name, None if term.joint is None else term.joint + 1, float(gain), kept, why)


@dataclass(frozen=True)
class Candidate:
    """A term with what it would add."""

    term: Term
    gain: float
    coefficients: Float


@dataclass
class Solution:
    """The terms found, their fit, and what was tried on the way."""

    problem: Problem
    terms: list[Term]
    fit: Regression
    factor: Float
    tried: list[Trial] = field(default_factory=list)
    spent: bool = False
    """True if the time was up before all was tried."""
    rivals: dict[tuple[str, int | None], tuple[float, tuple[Candidate, ...]]] = field(default_factory=dict)
    """Evidence of each term beside the others, and of the best other names in its place."""

    @property
    def residual(self) -> Float:
        """Residual (N, C)."""
        return self.fit.residual

    def block(self, term: Term) -> tuple[Block, slice]:
        """The block of a term in the fit and the place of its coefficients."""
        at = self.terms.index(term)
        return self.fit.blocks[at], self.fit.slices[at]

    def coefficients(self, term: Term) -> Float:
        """The coefficients (m,) of a term in the fit."""
        return np.asarray(self.fit.coefficients[self.block(term)[1]])
