"""Declaration of an effect: the signal it acts on, the states it depends on, and the conditions to accept it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Literal

Place = Literal["joint", "robot", "supply"]
ActsOn = Literal["joint", "friction", "links", "drive", "reading", "supply"]
"""Signal that an effect changes:

- ``joint``: the torque of a joint, Nm;
- ``friction``: the same, but as a change of Coulomb friction, which must be there;
- ``links``: the load that the links are, Nm at all joints;
- ``drive``: the torque that a servo gives for its command, where no torque was measured;
- ``reading``: the torque as measured, after all mechanics (gain, delay, clipping, offset);
- ``supply``: the power of the supply, W.
"""
DependsOn = Literal["motion", "load", "fitted torque", "residual"]
"""States that the columns or the shapes to try are computed from, besides the motion:

- ``motion``: nothing; columns are computed once;
- ``load``: the torque that the links need, by the model of the moment;
- ``fitted torque``: the torque of the fit;
- ``residual``: what is unexplained yet.
"""


@dataclass(frozen=True)
class Form:
    """Form of the columns."""

    to_scale: bool = False
    """Simulated to scale: the coefficient is 1 within a few per cent."""
    reverses: bool = False
    """The first coefficient (Nm) changes sign with the velocity, whose sign is not known well near stops."""
    intermittent: bool = False
    """There at some times only: no data can be left out."""
    sample_by_sample: bool = False
    """Simulated sample by sample, which is slow and sensitive: tried only where fast residuals are left."""
    error: float = 0.0
    """Share of what it adds by which its form may be wrong: what adds less beside it is not accepted."""


@dataclass(frozen=True)
class Acceptance:
    """Conditions on an effect besides its evidence."""

    above: float | None = None
    """Value that the first coefficient must exceed; None: it has either sign."""
    inside_bounds: bool = False
    """Its shape may not run to one of its bounds."""
    several_channels: bool = False
    """A fact of the whole recording or arm: more than one channel must ask for it."""
    prior_deviations: float = float("inf")
    """Standard deviations of its prior that a coefficient may be off: beyond, it stands for something else."""
    longest_run: float = 0.0
    """s that the longest run must last to show it."""
    least_rate: float = 0.0
    """Samples a second that it takes to show it."""
    usual: bool = False
    """Most arms have it: data left out alone may confirm it, where much else is unexplained."""
    by_evidence: float = float("inf")
    """nats from which evidence alone confirms it, whatever data left out say."""
    common: bool = False
    """No rare thing: half as much evidence is asked."""


@dataclass(frozen=True)
class Relations:
    """Relations to other effects."""

    contains: tuple[str, ...] = ()
    """Effects that it contains as a special case: it always fits as well, and is no rival of theirs."""
    family: str = ""
    """Effects of one family stand for one another: one of them at a joint."""
    plainer: float = 0.0
    """nats by which it goes before a name that fits as well: the plainer fact of an installation."""
    along: Literal["", "position", "velocity"] = ""
    """What its torque is a law of, where it is a law of one thing: a free curve of that must not fit much better."""
    upon: tuple[str, ...] = ()
    """Effects that are there wherever it is: with evidence of their own, they stay though it can stand for them."""
    beats: tuple[str, ...] = ()
    """Plainer effects in whose place it must lower the error on data left out."""


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of its parameters that no data remove."""

    inherited: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Share of a parameter that is uncertain with the description it is computed with; ``INHERITED`` if left out."""
    torque_gain: tuple[str, ...] = ()
    """Parameters that are off by the factor by which all measured torques are off: nothing in the data shows it."""


@dataclass(frozen=True)
class Confusion:
    """An effect that can look the same, and the experiment that separates the two."""

    effect: str
    experiment: str
