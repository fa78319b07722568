"""Judges one known cycle: separates harmless changes of power from faults."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.faults.cycles.best_effects import WARM, BestExplanation, explain, odds_of, temper_of
from cellwatt_plugins.faults.cycles.effects import warm_up
from cellwatt_plugins.faults.cycles.identify import FittedArm
from cellwatt_plugins.faults.cycles.known import Known
from cellwatt_plugins.faults.cycles.match import Match
from cellwatt_plugins.faults.cycles.off_path import STOPPED, interpretations
from cellwatt_plugins.faults.cycles.pattern import Pattern
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.cycles.samples import Samples, sample
from cellwatt_plugins.faults.cycles.weigh import fit
from cellwatt_plugins.robot.regression import Products, Whitener

LEAST, LEAST_BARE = 2.0, 4.0
"""Smallest peak power of a reported fault, W, of an arm with and without a description."""
BESIDE = 0.1
"""Smallest peak power of a further fault, as a share of the largest fault's: a smaller one may be a model error …"""
BESIDE_STOPPED = 0.2
"""… and if a joint stands still, as only the model gives the power that its motion would have needed …"""
BESIDE_BARE = 0.3
"""… and for an arm without a description."""
CLOSE, CLOSE_YET, CLOSE_YET_BARE = 3.0, 7.0, 40.0
"""Joints whose log odds differ by less than this cannot be distinguished, in a whole cycle and in a running one, there
also of an arm without a description."""
CERTAIN = 3.0
"""Smallest warm-up that is reported, in its standard deviations."""


@dataclass(frozen=True)
class Blame:
    """A fault of ``joint`` (0-based) that changes the power by ``watts`` (N,); ``alternatives`` explain it as well.

    ``confidence``: probability that this joint is faulty; ``certainty``: probability that any joint is.
    """

    joint: int
    what: str
    watts: Float
    confidence: float
    alternatives: tuple[int, ...]
    certainty: float


@dataclass(frozen=True)
class Verdict:
    """Findings on a cycle: ``residual`` (N,) W from healthy power at ``tau`` (N,) s of the pattern, with its noise
    ``sigma`` (N,) W; ``encoders``: confidence by joint with a wrong encoder; ``harmless``: kg of a part (share of the
    load, of a bare arm), or W of the supply since a moment in the cycle, and ``warm`` share of friction, above the
    healthy value; ``misfit``: unexplained variance relative to the noise; ``foreign``: probability of another task."""

    tau: Float
    residual: Float
    sigma: Float
    blames: tuple[Blame, ...]
    encoders: dict[int, float]
    harmless: dict[str, float]
    warm: float
    misfit: float
    foreign: float


def examine(
    recording: Recording, match: Match, known: Known, until: float = math.inf, since: float = -math.inf
) -> Verdict | None:
    """The verdict on one cycle between two pattern times, s; None if it has too few power samples."""
    pattern, arm, odds = known.patterns[match.pattern], known.arm, odds_of(known.false_alarms)
    samples = sample(recording, match, pattern, arm, since, until)
    if samples is None:
        return None
    inside = _inside(pattern, samples.tau, until)
    answers = [explain(arm, samples, r, inside, odds) for r in interpretations(recording, match, pattern, arm, samples)]
    temper = min(temper_of(answer.misfit) for answer in answers)
    weights = _weights(answers, temper, match.known)
    best = _most_likely(answers, weights)
    chosen = best.interpretation
    residual, gone = chosen.residual, samples.residual - chosen.residual
    blames = [
        Blame(joint, cause, gone, sure := _stands(answers, weights, joint), (), sure)
        for joint, cause in chosen.causes
        if cause in STOPPED
    ]
    harmless: dict[str, float] = {}
    rivals = iter(best.rivals)
    for effect, sizes, watts in zip(best.effects, best.sizes, best.watts, strict=True):
        residual = residual - watts
        if effect.joint is None:
            harmless[effect.what] = effect.sigma * float(sizes[0])
            continue
        close = CLOSE if until == math.inf else CLOSE_YET_BARE if arm.bare else CLOSE_YET
        blames.append(Blame(effect.joint, effect.what, watts, *_standing(next(rivals), effect.joint, temper, close)))
    least, beside = (LEAST_BARE, BESIDE_BARE) if arm.bare else (LEAST, BESIDE_STOPPED if chosen.stopped else BESIDE)
    largest = max((np.abs(blame.watts).max() for blame in blames), default=0.0)
    named = tuple(b for b in blames if b.what in STOPPED or np.abs(b.watts).max() >= max(least, beside * largest))
    encoders = {j: 1.0 - _stands(answers, weights, j) for j, cause in chosen.causes if cause not in STOPPED}
    warm = _warm(arm, samples, best, residual)
    foreign = float(weights[[answer.interpretation.foreign for answer in answers]].sum() / weights.sum())
    return Verdict(samples.tau, samples.residual, samples.sigma, named, encoders, harmless, warm, best.misfit, foreign)


def _inside(pattern: Pattern, tau: Float, until: float) -> Float:
    """(N, M + 1): 1 from the start of each move on, and from the end of the last; only moves before ``until`` s."""
    moves = [(start, end) for start, end in pattern.moves if start < until]
    edges = [start for start, _ in moves] + [moves[-1][1]]
    return np.column_stack([(tau >= edge).astype(np.float64) for edge in edges])


def _weights(answers: Sequence[BestExplanation], temper: float, foreign: float) -> Float:
    """Probability of each explanation, up to a common factor, with the evidence divided by ``temper``; ``foreign``: log
    odds against another task."""
    scores = np.array([a.likelihood / temper - a.odds - foreign * a.interpretation.foreign for a in answers])
    return np.asarray(np.exp(scores - scores.max()))


def _most_likely(answers: Sequence[BestExplanation], weights: Float) -> BestExplanation:
    """The best explanation with the most likely set of joints that stand still, of whatever cause."""
    sums: dict[tuple[int, ...], float] = {}
    for answer, weight in zip(answers, weights, strict=True):
        sums[answer.interpretation.stopped] = sums.get(answer.interpretation.stopped, 0.0) + float(weight)
    stopped = max(sums, key=lambda joints: sums[joints])
    standing = [k for k, answer in enumerate(answers) if answer.interpretation.stopped == stopped]
    return answers[max(standing, key=lambda k: float(weights[k]))]


def _stands(answers: Sequence[BestExplanation], weights: Float, joint: int) -> float:
    """Probability over all explanations that a joint stands still."""
    stands = np.array([joint in a.interpretation.stopped for a in answers])
    return float(weights[stands].sum() / weights.sum())


def _standing(
    rivals: dict[int, tuple[float, float]], joint: int, temper: float, width: float
) -> tuple[float, tuple[int, ...], float]:
    """Confidence in a joint against all others and none, its close alternatives, and the certainty of any fault."""
    scores = {other: gain / temper - odds for other, (gain, odds) in rivals.items()}
    top = max(scores.values())
    weights = {other: math.exp(score - top) for other, score in scores.items()}
    close = tuple(o for o, s in sorted(scores.items()) if o not in (-1, joint) and s > scores[joint] - width)
    every = sum(weights.values())
    return weights[joint] / every, close, 1.0 - weights[-1] / every


def _warm(arm: FittedArm, samples: Samples, best: BestExplanation, residual: Float) -> float:
    """Share by which the friction of all joints was higher; 0 if that is not certain."""
    column = WARM * warm_up(arm.parameters, best.interpretation.load)
    harmless = np.column_stack([samples.harmless, best.interpretation.doubt])
    white = Whitener.of(samples.sigma, harmless, samples.group)
    found = fit(Products.of(white(column[:, None]), white(residual)))
    size = float(found.coefficients[0])
    return WARM * size if abs(size) > CERTAIN * found.deviations[0] else 0.0
