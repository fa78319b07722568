"""Servos as the motion tells them, written into an MJCF; what that is worth is told by rolling the file out."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import ConfigError
from cellwatt_plugins.mismatch.explain import Explained
from cellwatt_plugins.mismatch.fit.problem import Problem
from cellwatt_plugins.mismatch.fit.retuning import FIXED, all_fixed, confirmed, links_fixed
from cellwatt_plugins.mismatch.fit.search.solve import fitted
from cellwatt_plugins.mismatch.fit.solution import Solution
from cellwatt_plugins.mismatch.input.run import Run
from cellwatt_plugins.mismatch.simulators.callback import write_callback
from cellwatt_plugins.mismatch.simulators.correction import holds
from cellwatt_plugins.mismatch.simulators.mend import (
    RISES,
    ChannelError,
    Mended,
    ToMend,
    left_of,
    target_of,
    verify,
    write,
)
from cellwatt_plugins.mismatch.simulators.rollout import WINDOW, rms_of, rolled_out
from cellwatt_plugins.mismatch.simulators.target import Target
from cellwatt_plugins.robot.regression import Prior
from cellwatt_plugins.robot.servo.law import Servo

Float = NDArray[np.float64]

SAME = 0.1
"""Share of the encoders' noise by which a joint may follow worse: that is none."""
ROLLED = (
    f"Errors are of the file rolled out under the recorded commands, begun anew each {WINDOW:.0f} s where the arm was."
)
WRITTEN = ("drive_gain", "torque_saturation")
"""Effects of drives that an actuator has a number for."""
LATE = (2, 3)
"""Places, among the numbers of a drive, of what no actuator has."""


def _choices(found: Explained) -> Iterator[Solution]:
    """What the file may hold, fitted, with more and more numbers as the user has them; delays are none of it."""
    torque = found.torque
    free = _without_delays(torque.free or torque.problem)
    terms = [t for t in torque.terms if holds(t) or t.effect.name in WRITTEN]
    for freedom in (confirmed(free, terms, torque.factor), links_fixed(free), all_fixed(free)):
        yield fitted(freedom.of(free), terms)
    for _ in range(len(terms)):
        terms = terms[:-1]
        yield fitted(all_fixed(free).of(free), terms)


def _without_delays(problem: Problem) -> Problem:
    """The problem of drives without the delays that an MJCF does not hold."""
    joints, priors = len(problem.floor), []
    for i, block in enumerate(problem.nuisance):
        prior = block.prior
        if i >= len(problem.nuisance) - joints:
            spread = prior.deviations.copy()
            spread[list(LATE)] *= FIXED
            prior = Prior.spread(spread)
        priors.append(prior)
    return problem.with_priors(priors)


def _servo(solution: Solution) -> Servo:
    """The servos (n,) that a solution tells: of error and velocity, (1 + a) · torque + (a + b) · damping · velocity."""
    problem = solution.problem
    own, joints = problem.states[0].servos.servo, len(problem.floor)
    numbers = [solution.fit.coefficients[place][:2] for place in problem.design.slices[-joints:]]
    pull, braked = np.array(numbers).T
    low, high = own.low.copy(), own.high.copy()
    for term in solution.terms:
        joint = term.joint or 0
        if term.effect.name == "drive_gain":
            pull[joint] += solution.coefficients(term)[0]
        elif term.effect.name == "torque_saturation":
            low[joint], high[joint] = -term.shape[0], term.shape[0]
    return replace(
        own,
        pull=own.pull / (1 + pull),
        stiffness=own.stiffness / (1 + pull),
        damping=own.damping * np.maximum(1 + pull + braked, 0.0) / (1 + pull),
        low=low,
        high=high,
    )


def mend_driven(found: Explained, runs: Sequence[Run], user: ToMend, out: Path) -> Mended:
    """``mend`` where motion alone is known: of what the file may hold, that is written which follows the arm best.

    Each is rolled out under the recorded commands, and no joint may follow worse. Raises ``ConfigError`` where the
    file cannot be changed.
    """
    simulator, frames = user.simulator, user.frames
    noise = np.max([run.drive.moved.resolution for run in runs if run.drive is not None], axis=0)
    before = rms_of(rolled_out(simulator.path, simulator.joints, runs))
    best: tuple[float, Solution, Float] | None = None
    for solution in _choices(found):
        with tempfile.TemporaryDirectory() as folder:
            written = write(simulator, _goal(found, solution, user), Path(folder))
            after = rms_of(rolled_out(written.path, simulator.joints, runs))
        if np.any(after > RISES * before + SAME * noise):
            continue
        left = float(np.sum(np.log((after + noise) / (before + noise))))
        if best is None or left < best[0]:
            best = left, solution, after
    if best is None:
        raise ConfigError(
            f"{simulator.path}: not mended: whatever is written, a joint follows its commands worse than before; what "
            "was found is in findings.json and model.yaml"
        )
    _, solution, after = best
    goal = _goal(found, solution, user)
    written = write(simulator, goal, out)
    verify(simulator, frames, goal, solution.problem, written)
    stiffness = solution.problem.states[0].servos.servo.stiffness
    left_out = [
        replace(
            left,
            rms=left.rms / float(stiffness[(left.joint or 1) - 1]),
            unit=simulator.unit((left.joint or 1) - 1, "rad"),
        )
        for left in left_of(found, solution, [*goal.refused, *written.refused])
        if left.effect not in WRITTEN
    ]
    error = tuple(
        ChannelError(f"q_{j + 1}", simulator.unit(j, "rad"), float(b), float(a), float(f))
        for j, (b, a, f) in enumerate(zip(before, after, noise, strict=True))
    )
    beside = write_callback(written.path, simulator.joints, found.model.terms)
    more = () if beside is None else (f"What the file cannot hold is in {beside.name}, a callback for MuJoCo.",)
    notes = (*simulator.notes, *frames.notes, *goal.notes, ROLLED, *more)
    return Mended(written.path, tuple(written.applied), tuple(left_out), error, notes)


def _goal(found: Explained, solution: Solution, user: ToMend) -> Target:
    return replace(target_of(user.simulator, user.frames, solution, found.mounted), servo=_servo(solution))
