"""Findings of ``explain`` with their parameters, location and improvement; written as ``findings.json``."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, Literal, Self

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.problem import Problem
from cellwatt_plugins.explain.fit.solution import Trial
from cellwatt_plugins.robot.effects.effect import Parameter

Verdict = Literal["no_mismatch", "explained", "partly_explained", "unexplained"]
Kind = Literal["missing", "structure", "mistuned"]
"""Physics that the simulation lacks, a structure that it has otherwise, or a number of it that is off."""
StepKind = Literal["simulation", "finding", "curve", "retuning"]


@dataclass(frozen=True)
class Span:
    """A stretch of one recording, s."""

    recording: str
    start: float
    end: float


@dataclass(frozen=True)
class Where:
    """Location of a mismatch; None means everywhere."""

    channels: tuple[str, ...]
    position: tuple[float, float] | None = None
    """rad, of the joint."""
    velocity: tuple[float, float] | None = None
    """rad/s."""
    times: tuple[Span, ...] = ()


@dataclass(frozen=True)
class ErrorOfChannel:
    """Error of one channel before and after a change of the simulation."""

    channel: str
    unit: str
    before: float
    after: float
    noise_floor: float

    @classmethod
    def at(cls, problem: Problem, channel: int, before: Float, after: Float) -> Self:
        """That of a channel (0-based), from the errors (C,) of all channels."""
        floor = float(problem.floor[channel])
        return cls(*problem.channel(channel), float(before[channel]), float(after[channel]), floor)


@dataclass(frozen=True)
class Improvement(ErrorOfChannel):
    """Error of one channel before and after the finding's step of the cascade, with the user's parameters unchanged."""

    held_out: bool = True


@dataclass(frozen=True)
class Alternative:
    """Another name that fits the data as well, and the experiment that would separate the two."""

    effect: str
    joint: int | None
    why: str


@dataclass(frozen=True)
class Finding:
    """One effect that the simulation lacks, or one parameter that is off."""

    effect: str
    joint: int | None
    """1-based; None for the whole robot or the supply."""
    kind: Kind
    confidence: float
    """Probability, 0 to 1, that the effect is present under this name."""
    statement: str
    """One plain sentence."""
    parameters: dict[str, Parameter]
    where: Where
    improvement: Improvement
    alternatives: tuple[Alternative, ...] = ()
    was: float | None = None
    """The simulation's value, which the first parameter corrects; None if the simulation has no such term."""
    followed: bool = True
    """False for an effect without a law in the model: an unknown effect, or unpredictable blows."""


@dataclass(frozen=True)
class UnexplainedChannel:
    """A channel whose residual stays above its noise floor after all findings."""

    channel: str
    rms: float
    noise_floor: float
    statement: str
    velocity: tuple[float, float] | None = None
    position: tuple[float, float] | None = None
    looked_at: bool = True
    """False if the time limit was reached before the channel's candidates were tried."""


@dataclass(frozen=True)
class FoundCurve:
    """A curve of unknown form that a joint's torque follows; stored in the model as a table."""

    channel: str
    along: str
    """The quantity along the curve: ``its velocity``."""
    unit: str
    """Unit of the knots."""
    knots: tuple[float, ...]
    values: tuple[float, ...]
    """Nm at the knots."""
    share: float
    """Share of the mean square error on data left out that the curve removes."""
    statement: str


@dataclass(frozen=True)
class Step:
    """A step from the user's simulation to the model, and the error after it."""

    kind: StepKind
    label: str
    effect: str
    """Name of the effect of a finding or a curve."""
    joint: int | None
    """1-based; None for the whole robot or the supply."""
    error: float
    """Geometric mean of the channels' errors, each in units of its noise, so that no channel outweighs the others."""
    channels: dict[str, float]
    """Rms error of each channel."""
    held_out: bool
    """True if the error is on data left out of the fit."""


@dataclass(frozen=True)
class RetunedNumber:
    """A parameter of the simulation with its value from the recordings: not a finding, but it explains much of a
    joint."""

    parameter: str
    """``mass``, ``coulomb_friction``, …"""
    joint: int | None
    """1-based; for a link's parameter the joint that moves the link, None for the supply."""
    was: float
    now: float
    std: float
    unit: str
    tolerance: float
    """Tolerance of the description: one standard deviation, in ``unit``."""
    beyond: bool
    """True if the parameter is certainly off by more than twice the tolerance."""
    statement: str

    @property
    def off(self) -> float:
        """Correction that the recordings give, in ``unit``."""
        return self.now - self.was


@dataclass(frozen=True)
class ChannelFit:
    """Held-out error of the simulation, of the nominal parameters refitted, and of the model."""

    channel: str
    unit: str
    simulation: float
    refit: float
    model: float
    noise_floor: float


@dataclass(frozen=True)
class Other:
    """A recording that was not used for fitting, compared with the model: the channel with the largest deviation."""

    recording: str
    explained: bool | None
    """None if the recording could not be compared, for the reason in ``why``."""
    channel: str = ""
    unit: str = ""
    error: float = 0.0
    """Rms error of the model; ``usual`` is the error on data left out of the fit."""
    usual: float = 0.0
    why: str = ""


@dataclass(frozen=True)
class Findings:
    """Everything that ``explain`` found."""

    verdict: Verdict
    findings: tuple[Finding, ...]
    unexplained: tuple[UnexplainedChannel, ...] = ()
    fit: tuple[ChannelFit, ...] = ()
    tried: tuple[Trial, ...] = ()
    notes: tuple[str, ...] = field(default=())
    """Remarks on what the data could not show, e.g. effects that this motion does not excite."""
    others: tuple[Other, ...] = ()
    """Recordings that were compared with the model, but not analysed."""
    curves: tuple[FoundCurve, ...] = ()
    """Curves that the residual follows."""
    retuned: tuple[RetunedNumber, ...] = ()
    """Parameters of the simulation that are off beyond their tolerance, or that reduce a joint's error most."""
    cascade: tuple[Step, ...] = ()
    """Steps from the user's simulation to the model: each finding added in turn, largest first."""

    @property
    def without_finding(self) -> tuple[UnexplainedChannel, ...]:
        """The unexplained channels that have no finding."""
        named = {f.improvement.channel for f in self.findings if not f.followed}
        return tuple(rest for rest in self.unexplained if rest.channel not in named)

    def as_json(self) -> dict[str, Any]:
        """The content of ``findings.json``."""
        return asdict(self)
