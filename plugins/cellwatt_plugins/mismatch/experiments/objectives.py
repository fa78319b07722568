"""Objectives of an experiment: to tell two names apart, or to detect what the recordings could not show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.mismatch.experiments.expected_evidence import ExpectedEvidence
from cellwatt_plugins.mismatch.experiments.expected_motion import expected_states
from cellwatt_plugins.mismatch.experiments.library import Experiment, arm_experiments
from cellwatt_plugins.mismatch.experiments.limits import Limits
from cellwatt_plugins.mismatch.explain import Explained
from cellwatt_plugins.mismatch.fit.problem import Term
from cellwatt_plugins.mismatch.fit.solution import Solution
from cellwatt_plugins.mismatch.fit.thresholds import DEFAULT
from cellwatt_plugins.mismatch.model import Model
from cellwatt_plugins.mismatch.verdict.findings import Finding
from cellwatt_plugins.robot.effects import EFFECTS
from cellwatt_plugins.robot.effects.effect import Effect
from cellwatt_plugins.robot.effects.states import States

Float = NDArray[np.float64]

SURE = 11.0
"""nats expected from which on 95 % of all recordings show odds of 19 to 1: evidence scatters by √(2 · nats)."""
PAIRS = 3
"""Pairs of names asked about, the closest first."""
REFERENCE = "excitation"
"""The experiment that moves all joints: a joint's effects are sizeable if they are on this motion."""
CLEAR = 3.0
"""Times the noise floor from which an effect is sizeable at least."""


@dataclass(frozen=True, eq=False)
class ExpectedRun:
    """An experiment as it is expected to be recorded."""

    experiment: Experiment
    states: States
    joint: int | None
    """0-based, where it is on one joint."""
    sides: dict[str, ExpectedEvidence] = field(default_factory=dict)
    """Of both sides, once they are asked for."""

    def evidence(self, solution: Solution) -> ExpectedEvidence:
        """The recordings of a side with the experiment behind them."""
        side = solution.problem.side
        if side not in self.sides:
            self.sides[side] = ExpectedEvidence(solution, self.states)
        return self.sides[side]


class Objective(Protocol):
    """Something that the recordings do not tell."""

    @property
    def aim(self) -> str:
        """In words that follow ``to``."""
        ...

    @property
    def instead(self) -> str:
        """Advice for the case that no trajectory tells."""
        ...

    @property
    def joints(self) -> frozenset[int]:
        """Joints (0-based) whose own experiments may tell."""
        ...

    @property
    def least_time(self) -> float:
        """s that an experiment must last to tell."""
        ...

    def suits(self, joint: int | None) -> bool:
        """True if an experiment on a joint (None: on all) may tell."""
        ...

    def nats(self, run: ExpectedRun) -> float:
        """Log evidence that an experiment is expected to add."""
        ...


@dataclass(frozen=True, eq=False)
class Discrimination:
    """Tell which of two names is right."""

    solution: Solution
    term: Term
    rival: Term
    now: tuple[float, float]
    """nats by which each leads in the recordings, were it the true one."""
    instead: str
    joints: frozenset[int]

    @property
    def aim(self) -> str:
        """In words."""
        return f"tell {_called(self.term)} from {_called(self.rival)}"

    @property
    def least_time(self) -> float:
        """Longest time in s that either effect asks for."""
        return max(self.term.effect.acceptance.longest_run, self.rival.effect.acceptance.longest_run)

    def suits(self, joint: int | None) -> bool:
        """On all joints, or on one of its own."""
        return joint is None or joint in self.joints

    def nats(self, run: ExpectedRun) -> float:
        """The less of what it adds if either is true."""
        term, rival = leads(run.evidence(self.solution), self.term, self.rival)
        return min(term - self.now[0], rival - self.now[1])


@dataclass(frozen=True, eq=False)
class Detection:
    """Tell if an effect is there that the recordings could not show."""

    solution: Solution
    term: Term
    size: Float
    """Coefficients (m,) from which on it matters."""
    now: float
    """nats with which the recordings speak of it."""

    instead = "within these limits it does not show beside what may be off by its tolerance"

    @property
    def aim(self) -> str:
        """In words."""
        return f"test for {_called(self.term)}"

    @property
    def joints(self) -> frozenset[int]:
        """None: experiments on all joints tell."""
        return frozenset()

    @property
    def least_time(self) -> float:
        """Time in s that the effect asks for."""
        return self.term.effect.acceptance.longest_run

    def suits(self, joint: int | None) -> bool:
        """Experiments on all joints."""
        return joint is None

    def nats(self, run: ExpectedRun) -> float:
        """Log evidence in nats that a run adds."""
        if _too_short([run.states], self.term.effect):
            return 0.0
        return run.evidence(self.solution).against(self.term, self.size) - self.now


def leads(evidence: ExpectedEvidence, term: Term, rival: Term) -> tuple[float, float]:
    """nats by which a term leads its rival if it is the true one, and the rival if that is."""
    return evidence.lead(term, rival), evidence.lead(rival, term)


def objectives_of(found: Explained, limits: Limits) -> list[Objective]:
    """Pairs of names that are close, the closest first; where there is none, effects that could not be tested."""
    sides = [found.torque] if found.supply is None else [found.torque, found.supply]
    pairs = [(closeness, objective) for side in sides for closeness, objective in _pairs(found.findings.findings, side)]
    if pairs:
        return [objective for _, objective in sorted(pairs, key=lambda pair: -pair[0])[:PAIRS]]
    return list(_untested(found.torque, found.model, limits))


def _pairs(findings: Sequence[Finding], solution: Solution) -> list[tuple[float, Discrimination]]:
    """The alternatives of a side's findings with the share of the evidence that they reach."""
    out: list[tuple[float, Discrimination]] = []
    now = ExpectedEvidence(solution, None)
    terms = {term.place: term for term in solution.terms}
    for finding in findings:
        term = terms.get(_place(finding.effect, finding.joint))
        if term is None:
            continue
        own, rivals = solution.rivals[term.place]
        for candidate in rivals:
            if (reason := _listed(finding, candidate.term)) is not None:
                joints = _joints(solution, term, candidate.term)
                objective = Discrimination(
                    solution, term, candidate.term, leads(now, term, candidate.term), reason, joints
                )
                out.append((candidate.gain / max(own, 1e-9), objective))
    return out


def _listed(finding: Finding, rival: Term) -> str | None:
    """Why a rival is named beside a finding; None where it is not."""
    return next((a.why for a in finding.alternatives if _place(a.effect, a.joint) == rival.place), None)


def _place(effect: str, joint: int | None) -> tuple[str, int | None]:
    return effect, None if joint is None else joint - 1


def _joints(solution: Solution, term: Term, rival: Term) -> frozenset[int]:
    """Joints of both; where neither has one, the joint on which the load changes most."""
    own = frozenset(joint for joint in (term.joint, rival.joint) if joint is not None)
    if own:
        return own
    load = np.concatenate([s.rigid for s in solution.problem.states])
    return frozenset({int(np.argmax(np.ptp(load, axis=0)))})


def _untested(solution: Solution, model: Model, limits: Limits) -> list[Detection]:
    """Effects on which the recordings are silent at a size that matters."""
    recorded = solution.problem.states
    trajectory = next(e for e in arm_experiments(limits, recorded) if e.name == REFERENCE).trajectory
    reference = expected_states(REFERENCE, trajectory.sampled(max(recorded[0].step, 0.02)), model, recorded)
    size = np.maximum(solution.problem.size, CLEAR * solution.problem.floor)
    now = ExpectedEvidence(solution, None)
    out = []
    for term in _lasting(reference, solution):
        columns = term.effect.columns(reference, term.joint, term.shape)
        prior = term.effect.prior([reference], term.joint, columns, size)
        sizeable = prior.mean + np.sqrt(np.diag(prior.covariance))
        told = 0.0 if _too_short(recorded, term.effect) else now.against(term, sizeable)
        if told < DEFAULT.gain:
            out.append(Detection(solution, term, sizeable, told))
    return out


def _lasting(reference: States, solution: Solution) -> list[Term]:
    """Mechanical effects at every joint that are there all the time, each with a middle shape."""
    nothing = [np.zeros_like(reference.q)]
    out = []
    for effect in EFFECTS:
        if effect.acts_on in ("supply", "reading") or effect.depends_on not in ("motion", "load"):
            continue
        if effect.form.sample_by_sample:
            continue
        places = range(len(reference.robot.joints)) if effect.place == "joint" else [None]
        for joint in places:
            if not effect.possible(reference.robot, joint) or (effect.name, joint) in {t.place for t in solution.terms}:
                continue
            shapes = effect.shapes([reference], joint, nothing)
            if shapes:
                out.append(Term(effect, joint, shapes[len(shapes) // 2]))
    return out


def _too_short(states: Sequence[States], effect: Effect) -> bool:
    return max(float(s.time[-1] - s.time[0]) for s in states) < effect.acceptance.longest_run


def _called(term: Term) -> str:
    name = term.effect.name.replace("_", " ")
    return name if term.joint is None else f"{name} at joint {term.joint + 1}"
