"""Thresholds at which `explain` takes a term: evidence, and error on data left out."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Thresholds:
    """Thresholds at which a term is accepted."""

    gain: float = 16.0
    """Log evidence (nats) that it must add; about 150 names are tried, chance adds 5."""
    share: float = 0.1
    """Share of its channel's mean square error on data left out that it must take off, ``steady`` standard errors."""
    felt: float = 0.2
    """The same where it does most, of what is of the whole arm: a tenth of the error of one joint at least."""
    near: float = 1.3
    """Mean square residual, in units of the noise, up to which a channel is near it: of what most arms
    have, any share will do, if ``sure``."""
    steady: float = 1.5
    sure: float = 2.5
    much: float = 0.15
    """Share that a term must take off, ``sure``, that adds less evidence than ``gain``."""
    murky: float = 0.0
    """Share that a term must take off a joint, ``sure``, of which ``much_left`` is left beside all terms: of something
    that is in no library, each name takes a little."""
    much_left: float = 10.0
    """Mean square residual, in units of the noise."""
    better: float = 0.4
    """Share of what a fancier name takes off that it must take off beyond a plainer one in its place."""
    certain: float = 8.0
    """Standard errors from which an unusual term stays that takes less off than it leaves beyond the noise."""
    least: float = 4.0
    """Log evidence (nats) that it must add in any case."""
    rise: float = 0.02
    """Share by which another channel's error may rise."""
    relaxed: float = 1.5
    """Stretch of the nominal parameters, in units of their number, that is within their tolerances."""
    blur: float = 4.0
    """Factor on another term's standard deviation from which the two cannot be told apart."""
    costly: float = 1.3
    """Mean square of the residual's fast part, in units of the noise, from which costly effects are tried."""
    most: int = 40
    """Terms at most."""


DEFAULT = Thresholds()


def by_law(thresholds: Thresholds) -> Thresholds:
    """Thresholds where a servo's law stands for the torque: its numbers are free, and noise near stops is not known.

    So what is near the noise must take off as much as elsewhere, and what is far from it more.
    """
    return replace(thresholds, near=0.0, steady=thresholds.sure, much=0.5, murky=0.35)
