"""Thresholds at which ``explain`` accepts a term: evidence, and error on data left out."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Thresholds:
    """Thresholds at which a term is accepted."""

    gain: float = 16.0
    """Log evidence (nats) that a term must add; about 150 names are tried, and chance adds 5."""
    share: float = 0.1
    """Share of its channel's mean square error on data left out that a term must remove."""
    felt: float = 0.2
    """``share`` for an unusual term of the whole arm, at the channel where it removes most."""
    near: float = 1.3
    """Mean square residual, in units of the noise, below which a channel is near its noise: there any share suffices,
    if it is removed by ``sure`` standard errors."""
    steady: float = 1.5
    """Standard errors of the removed share that suffice in general."""
    sure: float = 2.5
    """Standard errors required near the noise, or with little evidence."""
    much: float = 0.15
    """Share that a usual term must remove, by ``sure`` standard errors, if it adds less evidence than ``gain``."""
    murky: float = 0.0
    """Share that a term must remove, by ``sure`` standard errors, from a joint whose residual with all terms stays
    above ``much_left``: an effect that is in no library is matched a little by every name."""
    much_left: float = 10.0
    """Mean square residual, in units of the noise, above which a residual is large."""
    better: float = 0.4
    """Share of the error removed by a more complex name that it must remove beyond the plainer name in its place."""
    certain: float = 8.0
    """Standard errors above which an unusual term stays though it leaves more error than it removes."""
    clear: float = float("inf")
    """Log evidence (nats) from which errors at stops, where the fit counts samples little, do not refuse a term."""
    least: float = 4.0
    """Log evidence (nats) that any term must add."""
    rise: float = 0.02
    """Largest share by which another channel's error may rise."""
    relaxed: float = 1.5
    """Squared stretch of nominal parameters, per parameter, that is within their tolerances."""
    blur: float = 4.0
    """Factor on another term's standard deviation above which the two terms cannot be distinguished."""
    costly: float = 1.3
    """Mean square of the residual's fast part, in units of the noise, above which costly effects are tried."""
    most: int = 40
    """Largest number of terms."""


DEFAULT = Thresholds()


def by_law(thresholds: Thresholds) -> Thresholds:
    """Thresholds where a servo's law replaces measured torque: its parameters are free, noise near stops is unknown.

    A channel near the noise therefore requires as large a share as any other, and one far from it a larger share.
    """
    return replace(thresholds, near=0.0, steady=thresholds.sure, much=0.5, murky=0.35, clear=2 * thresholds.gain)
