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
- ``friction``: the torque of a joint as a change of its Coulomb friction, which it must have;
- ``links``: the load by the links, Nm at all joints;
- ``drive``: the torque of a servo for its command, where no torque was measured;
- ``reading``: the torque as measured, after all mechanics (gain, delay, clipping, offset);
- ``supply``: the power of the supply, W.
"""
DependsOn = Literal["motion", "load", "fitted torque", "residual"]
"""States that the columns or the shapes to try are computed from, besides the motion:

- ``motion``: nothing; columns are computed once;
- ``load``: the torque that the links need, in the current model;
- ``fitted torque``: the torque of the current fit;
- ``residual``: the current residual.
"""


@dataclass(frozen=True)
class Form:
    """Form of the columns."""

    to_scale: bool = False
    """Simulated to scale: the coefficient is 1 within a few per cent."""
    reverses: bool = False
    """The first coefficient (Nm) changes sign with the velocity, whose sign is uncertain near stops."""
    intermittent: bool = False
    """Active at some times only: data left out cannot test it."""
    sample_by_sample: bool = False
    """Simulated sample by sample, which is slow and sensitive: tried only where fast residuals remain."""
    error: float = 0.0
    """Relative error of its form: an effect that adds a smaller share of it is not accepted beside it."""


@dataclass(frozen=True)
class Acceptance:
    """Conditions on an effect besides its evidence."""

    above: float | None = None
    """Value that the first coefficient must exceed; None: it has either sign."""
    inside_bounds: bool = False
    """Its shape may not end at one of its bounds."""
    several_channels: bool = False
    """A property of the whole recording or arm: more than one channel must show it."""
    prior_deviations: float = float("inf")
    """Largest deviation of a coefficient from its prior, in standard deviations: beyond, it stands for another
    effect."""
    longest_run: float = 0.0
    """Duration in s that the longest run must have to show it."""
    least_rate: float = 0.0
    """Sampling rate in Hz that recordings must have to show it."""
    exact_times: bool = False
    """Samples must have exact times to show it."""
    usual: bool = False
    """Most arms have it: data left out are enough to confirm it, where much else is unexplained."""
    by_evidence: float = float("inf")
    """Evidence in nats that confirms it alone, whatever data left out show."""
    common: bool = False
    """Not rare: half as much evidence is required."""


@dataclass(frozen=True)
class Relations:
    """Relations to other effects."""

    contains: tuple[str, ...] = ()
    """Effects that are special cases of it: it always fits as well as they do, and is not their rival."""
    family: str = ""
    """Effects of one family are alternatives: at most one of them at a joint."""
    plainer: float = 0.0
    """Advantage in nats over another effect that fits as well: the plainer property of an installation."""
    along: Literal["", "position", "velocity"] = ""
    """The one state that its torque is a law of, if so: a free curve of that state must not fit much better."""
    upon: tuple[str, ...] = ()
    """Effects that are present wherever it is: with evidence of their own, they remain although it can replace them."""
    lessens: tuple[str, ...] = ()
    """Parameters of robot.yaml and effects of that name, of which its joint has one where the first coefficient is
    negative."""
    beats: tuple[str, ...] = ()
    """Plainer effects: compared with each of them, it must lower the error on data left out."""


@dataclass(frozen=True)
class Uncertainty:
    """Uncertainty of its parameters that no data reduce."""

    inherited: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))
    """Relative uncertainty of a parameter from the description that it is computed with; ``INHERITED`` if left out."""
    torque_gain: tuple[str, ...] = ()
    """Parameters that are wrong by the common factor of all measured torques, which no data show."""


@dataclass(frozen=True)
class Confusion:
    """An effect that can look the same, and the experiment that separates the two."""

    effect: str
    experiment: str
