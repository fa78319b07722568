"""Judges one known cycle: what of its power is harmless, and which faults explain the rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.faults.cycles.effects import PART, warm_up
from cellwatt_plugins.faults.cycles.evidence import fit, gram
from cellwatt_plugins.faults.cycles.explain import WARM, Answer, explain
from cellwatt_plugins.faults.cycles.identify import Arm
from cellwatt_plugins.faults.cycles.match import Match
from cellwatt_plugins.faults.cycles.pattern import Pattern
from cellwatt_plugins.faults.cycles.readings import readings
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.cycles.samples import Samples, sample

Float = NDArray[np.float64]

LEAST = 2.0
"""W that a fault must move the power by, for a moment, to be named."""
BESIDE = 0.1
"""Share of the largest fault's power below which nothing is named beside it: it may be the model's error."""
CLOSE = 3.0
"""Joints whose log odds are no further apart than this cannot be told apart."""
CERTAIN = 3.0
"""Standard deviations by which a warm-up must differ from none to be told."""


@dataclass(frozen=True)
class Blame:
    """A fault of ``joint`` (0-based) that moves the power by ``watts`` (N,); ``alternatives`` explain it as well.

    ``confidence`` that it is this joint, and ``certainty`` that it is any.
    """

    joint: int
    what: str
    watts: Float
    confidence: float
    alternatives: tuple[int, ...]
    certainty: float


@dataclass(frozen=True)
class Verdict:
    """What was found in a cycle: ``tau`` (N,) s of the pattern and ``residual`` (N,) W against healthy power;
    ``encoders`` off with their confidence; ``part`` kg and ``warm`` share of friction more than in healthy cycles;
    ``misfit``, variance that nothing explains, relative to the noise's."""

    tau: Float
    residual: Float
    blames: tuple[Blame, ...]
    encoders: dict[int, float]
    part: float
    warm: float
    misfit: float


def examine(recording: Recording, match: Match, pattern: Pattern, arm: Arm, until: float = math.inf) -> Verdict:
    """The verdict of one cycle, as far as the pattern's time ``until`` s."""
    samples = sample(recording, match, pattern, arm, until)
    inside = _inside(pattern, samples.tau, until)
    answers = [explain(arm, samples, r, inside) for r in readings(recording, match, pattern, arm, samples)]
    best = _most_likely(answers)
    part, left = 0.0, best.reading.residual
    blames = [
        Blame(
            joint, cause, samples.residual - best.reading.residual, _stands(answers, joint), (), _stands(answers, joint)
        )
        for joint, cause in best.reading.causes
        if cause != "encoder"
    ]
    rivals = iter(best.rivals)
    for effect, sizes in zip(best.effects, best.sizes, strict=True):
        watts = effect.columns @ sizes
        left = left - watts
        if effect.joint is None:
            part = PART * float(sizes[0])
            continue
        blames.append(Blame(effect.joint, effect.what, watts, *_standing(next(rivals), effect.joint)))
    largest = max((np.abs(blame.watts).max() for blame in blames), default=0.0)
    named = tuple(b for b in blames if np.abs(b.watts).max() >= max(LEAST, BESIDE * largest))
    encoders = {j: 1.0 - _stands(answers, j) for j, cause in best.reading.causes if cause == "encoder"}
    warm = _warm(arm, samples, best, left)
    return Verdict(samples.tau, samples.residual, named, encoders, part, warm, best.misfit)


def _inside(pattern: Pattern, tau: Float, until: float) -> Float:
    """(N, M + 1) 1 from the start of each move on, and from the end of the last; of those before ``until`` s."""
    moves = [(start, end) for start, end in pattern.moves if start < until]
    edges = [start for start, _ in moves] + [moves[-1][1]]
    return np.column_stack([(tau >= edge).astype(np.float64) for edge in edges])


def _most_likely(answers: Sequence[Answer]) -> Answer:
    """The best answer with the most likely set of joints that stand still, whatever makes them."""
    top = max(answer.score for answer in answers)
    weights: dict[tuple[int, ...], float] = {}
    for answer in answers:
        weights[answer.reading.stopped] = weights.get(answer.reading.stopped, 0.0) + math.exp(answer.score - top)
    stopped = max(weights, key=lambda joints: weights[joints])
    return max((a for a in answers if a.reading.stopped == stopped), key=lambda answer: answer.score)


def _stands(answers: Sequence[Answer], joint: int) -> float:
    """Probability that a joint stands still, among all readings."""
    weight = np.exp([a.score - max(b.score for b in answers) for a in answers])
    stands = np.array([joint in a.reading.stopped for a in answers])
    return float(weight[stands].sum() / weight.sum())


def _standing(rivals: dict[int, float], joint: int) -> tuple[float, tuple[int, ...], float]:
    """Confidence in a joint against all others and none, the joints that are close to it, and certainty of any."""
    top = max(rivals.values())
    weights = {other: math.exp(score - top) for other, score in rivals.items()}
    close = tuple(o for o, s in sorted(rivals.items()) if o not in (-1, joint) and s > rivals[joint] - CLOSE)
    every = sum(weights.values())
    return weights[joint] / every, close, 1.0 - weights[-1] / every


def _warm(arm: Arm, samples: Samples, best: Answer, left: Float) -> float:
    """Share by which friction of all joints was higher, 0 where that is not certain."""
    column = WARM * warm_up(arm.parameters, best.reading.load)
    harmless = np.column_stack([samples.harmless, best.reading.doubt])
    found = fit(gram(left, column[:, None], samples.sigma, harmless), np.array([0]))
    return WARM * float(found.sizes[0]) if abs(found.sizes[0]) > CERTAIN * found.error[0] else 0.0
