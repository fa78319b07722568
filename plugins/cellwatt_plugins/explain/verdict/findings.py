"""Findings of ``explain`` with their parameters, place and gain; written as ``findings.json``."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.problem import Problem
from cellwatt_plugins.explain.fit.solution import Trial
from cellwatt_plugins.robot.effects.effect import Parameter

Verdict = Literal["no_mismatch", "explained", "partly_explained", "unexplained"]
Kind = Literal["missing", "mistuned"]
StepKind = Literal["simulation", "finding", "curve", "retuning"]


@dataclass(frozen=True)
class Span:
    """A stretch of one recording, s."""

    recording: str
    start: float
    end: float


@dataclass(frozen=True)
class Where:
    """Place of a mismatch; None: everywhere."""

    channels: tuple[str, ...]
    position: tuple[float, float] | None = None
    """rad, of the joint itself."""
    velocity: tuple[float, float] | None = None
    """rad/s."""
    times: tuple[Span, ...] = ()


@dataclass(frozen=True)
class Improvement:
    """Error of one channel before and after the finding's step of the cascade: the user's numbers stay as they are."""

    channel: str
    unit: str
    before: float
    after: float
    noise_floor: float
    held_out: bool = True

    @classmethod
    def at(cls, problem: Problem, channel: int, before: Float, after: Float, held_out: bool = True) -> Improvement:
        """That of a channel (0-based) out of the errors (C,) of all."""
        floor = float(problem.floor[channel])
        return cls(*problem.channel(channel), float(before[channel]), float(after[channel]), floor, held_out)


@dataclass(frozen=True)
class Alternative:
    """Another name that fits the data as well, and the experiment that would separate the two."""

    effect: str
    joint: int | None
    why: str


@dataclass(frozen=True)
class Finding:
    """One effect that the simulation lacks (or whose number is off)."""

    effect: str
    joint: int | None
    """1-based; None for the whole robot or the supply."""
    kind: Kind
    confidence: float
    """Probability, 0 to 1, that the effect is there under this name."""
    statement: str
    """One plain sentence."""
    parameters: dict[str, Parameter]
    where: Where
    improvement: Improvement
    alternatives: tuple[Alternative, ...] = ()
    was: float | None = None
    """The simulation's own number, from which the first parameter is how far off; None where it has no such term."""
    followed: bool = True
    """False of what the model has no law of: something unknown, and blows that nothing foretells."""


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
    """False where the time was up before the channel's candidates were tried."""


@dataclass(frozen=True)
class FoundCurve:
    """A curve of no known form that a joint's torque follows; it is in the model as a table."""

    channel: str
    along: str
    """The course: ``its velocity``."""
    unit: str
    """Of the knots."""
    knots: tuple[float, ...]
    values: tuple[float, ...]
    """Nm at the knots."""
    share: float
    """Of the mean square error on data left out that it takes off."""
    statement: str


@dataclass(frozen=True)
class Step:
    """A step from the user's simulation to the model, and the error after it."""

    kind: StepKind
    label: str
    effect: str
    """Of a finding or a curve."""
    joint: int | None
    """1-based; None for the whole robot or the supply."""
    error: float
    """Geometric mean over the channels of their errors, each in units of its noise: no channel outweighs the others."""
    channels: dict[str, float]
    """Rms error of each channel."""
    held_out: bool
    """True if the error is that on data left out of the fit."""


@dataclass(frozen=True)
class RetunedNumber:
    """A number that the simulation has, as the recordings tell it: no finding, but what explains much of a joint."""

    parameter: str
    """``mass``, ``coulomb_friction``, …"""
    joint: int | None
    """1-based; of a link's number the joint that moves the link, None for the supply."""
    was: float
    now: float
    std: float
    unit: str
    tolerance: float
    """One standard deviation, in ``unit``, of what the description allows."""
    beyond: bool
    """True if the number is off by more than twice that."""
    statement: str


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
    """A recording that nothing was fitted to, beside the model: the channel that is furthest off."""

    recording: str
    explained: bool | None
    """None where it could not be compared, with the reason in ``why``."""
    channel: str = ""
    unit: str = ""
    error: float = 0.0
    """Rms error of the model; ``usual`` is that in the data left out of the fit."""
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
    """Remarks on what the data could not tell, e.g. effects that this motion cannot show."""
    others: tuple[Other, ...] = ()
    """Recordings beyond those that were looked at closely."""
    curves: tuple[FoundCurve, ...] = ()
    """What is left goes with."""
    retuned: tuple[RetunedNumber, ...] = ()
    """Numbers of the simulation that are off beyond their tolerance, or by which a joint's error falls most."""
    cascade: tuple[Step, ...] = ()
    """From the user's simulation to the model, each finding added in turn, largest first."""

    @property
    def without_finding(self) -> tuple[UnexplainedChannel, ...]:
        """The unexplained channels that no finding tells of."""
        told = {f.improvement.channel for f in self.findings if not f.followed}
        return tuple(rest for rest in self.unexplained if rest.channel not in told)

    def as_json(self) -> dict[str, Any]:
        """The content of ``findings.json``."""
        return asdict(self)
