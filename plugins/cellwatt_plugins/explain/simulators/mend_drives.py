"""Write servos identified from motion into an MJCF, and measure the error of its roll-outs."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.explain import Explained
from cellwatt_plugins.explain.fit.problem import Problem, Term
from cellwatt_plugins.explain.fit.retuning import FIXED, all_fixed, confirmed, freed, links_fixed
from cellwatt_plugins.explain.fit.search.solve import fitted
from cellwatt_plugins.explain.fit.solution import Solution
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.simulators.callback import write_callback
from cellwatt_plugins.explain.simulators.correction import holds
from cellwatt_plugins.explain.simulators.mend import RISES, Mended, finished, target_of, write
from cellwatt_plugins.explain.simulators.placing import Placing
from cellwatt_plugins.explain.simulators.rollout import WINDOW, rms_of, rolled_out
from cellwatt_plugins.explain.simulators.target import Target
from cellwatt_plugins.explain.verdict.findings import ErrorOfChannel
from cellwatt_plugins.robot.regression import Prior
from cellwatt_plugins.robot.servo.law import Servo

TRIES = 3
"""Number of fits; each fixes the numbers of the joints that followed worse in the fit before at the user's values."""
SAME = 0.1
"""Share of the encoders' noise up to which a larger error of a joint does not count as worse."""
ROLLED = (
    f"Errors are of roll-outs under the recorded commands, restarted every {WINDOW:.0f} s at the arm's recorded state."
)
HISTORY = "After a reset MuJoCo's commands are 0 until the delay is over; mj_initCtrlHistory sets other commands."
WIDTH = 0.01
"""Speed, rad/s, within which dry friction reverses, that is tried first."""
WIDTHS = (1.0, 2.0, 0.5, 1.4, 0.7, 1.2, 0.85)
"""Factors on the best speed so far, tried in turn."""
LATE = (2, 3)
"""Indices, among the numbers of a drive, of the delays, s, of its velocity and of its commands."""
DAMPED = {0: -1.0, 1: 0.0}
"""Delay of the damped velocity, in half steps, for the integrators Euler (0) and Runge-Kutta (1); 1 for others."""


def _starts(free: Problem, found: Explained) -> Iterator[tuple[Float, list[Term]]]:
    """Candidates to be fitted and written, with more and more numbers at the user's values.

    Their terms include effects that the file cannot hold, so that other numbers do not absorb them; the callback adds
    these effects.
    """
    terms = sorted(found.torque.terms, key=holds)
    yield confirmed(free, terms, found.torque.factor), terms
    yield links_fixed(free), terms
    for count in range(len(terms), -1, -1):
        yield all_fixed(free), terms[:count]


def _as_stepped(problem: Problem, model: Any) -> Problem:
    """The fit of drives as MuJoCo steps them, without the delays that an MJCF cannot hold.

    A command acts from the first step of its row on, half a step earlier than if held over the row. Implicit
    integrators damp the velocity at the end of a step, Euler's the velocity at its beginning.
    """
    joints, priors, half = len(problem.floor), [], 0.5 * model.opt.timestep
    for i, block in enumerate(problem.nuisance):
        prior = block.prior
        if i >= len(problem.nuisance) - joints:
            mean, spread = np.zeros(block.size), prior.deviations.copy()
            spread[list(LATE)] *= FIXED
            mean[list(LATE)] = half * DAMPED.get(int(model.opt.integrator), 1.0), -half
            prior = Prior.spread(spread, mean)
        priors.append(prior)
    return problem.with_priors(priors)


def _servo(solution: Solution) -> Servo:
    """The servos (n,) of a solution: (1 + a) · torque + (a + b) · damping · velocity is the user's law's torque."""
    problem = solution.problem
    own, joints = problem.states[0].servos.servo, len(problem.floor)
    numbers = [solution.fit.coefficients[place][:2] for place in problem.design.slices[-joints:]]
    pull, braked = np.array(numbers).T
    low, high, delay = own.low.copy(), own.high.copy(), own.delay.copy()
    for term in solution.terms:
        joint = term.joint or 0
        if term.effect.name == "drive_gain":
            pull[joint] += solution.coefficients(term)[0]
        elif term.effect.name == "torque_saturation":
            low[joint], high[joint] = -term.shape[0], term.shape[0]
        elif term.effect.name == "time_delay":
            delay += solution.coefficients(term)[0] * term.shape[0]
    return replace(
        own,
        pull=own.pull / (1 + pull),
        stiffness=own.stiffness / (1 + pull),
        damping=own.damping * np.maximum(1 + pull + braked, 0.0) / (1 + pull),
        low=low,
        high=high,
        delay=np.maximum(delay, 0.0),
    )


def mend_driven(found: Explained, runs: Sequence[Run], user: Placing, out: Path) -> Mended:
    """``mend`` for recordings without torque: write the candidate whose roll-outs follow the arm best.

    Each candidate is rolled out under the recorded commands, and no joint may follow worse; if no candidate is better,
    the user's numbers are written. Raises ``ConfigError`` if the file cannot be changed.
    """
    simulator = user.simulator
    noise = np.max([run.drive.moved.resolution for run in runs if run.drive is not None], axis=0)
    before = rms_of(rolled_out(simulator.path, simulator.joints, runs))
    free = _as_stepped(found.torque.free or found.torque.problem, simulator.model)
    unchanged = fitted(freed(free, all_fixed(free)), [])
    best = 0.0, _goal(found, unchanged, user), unchanged, before
    turnover, lever = None, free.states[0].servos.servo.lever
    for factors, terms in _starts(free, found):
        for _ in range(TRIES):
            solution = fitted(freed(free, factors), terms)
            goal = _goal(found, solution, user)
            turnover = _turnover(goal, WIDTH * lever, user, runs) if turnover is None else turnover
            goal = replace(goal, turnover=turnover)
            after = _errors(goal, user, runs)
            worse = np.flatnonzero(after > RISES * before + SAME * noise).tolist()
            if not worse:
                break
            # Friction, rotors and drives of these joints keep the user's values.
            factors = np.where([block.channel in worse for block in free.nuisance], FIXED, factors)
        score = float(np.sum(np.log((after + noise) / (before + noise))))
        if not worse and score < best[0]:
            best = score, goal, solution, after
    _, goal, solution, after = best
    error = tuple(
        ErrorOfChannel(f"q_{j + 1}", simulator.unit(j, "rad"), float(b), float(a), float(f))
        for j, (b, a, f) in enumerate(zip(before, after, noise, strict=True))
    )
    mended = finished(found, solution, user, goal, error, out)
    stiffness = solution.problem.states[0].servos.servo.stiffness
    left = tuple(
        replace(finding, rms=finding.rms / float(stiffness[at]), unit=simulator.unit(at, "rad"))
        for finding in mended.left
        for at in [(finding.joint or 1) - 1]
    )
    beside = write_callback(mended.path, simulator.joints, found.model.terms)
    notes = [*mended.notes, ROLLED]
    if best[0] == 0:
        notes.append("No finding makes the file follow better: its numbers stay unchanged.")
    if any(change.what == "delay" for change in mended.applied):
        notes.append(HISTORY)
    if beside is not None:
        notes.append(f"Effects that the file cannot hold are in {beside.name}, a callback for MuJoCo.")
    return replace(mended, left=left, notes=tuple(notes))


def _turnover(goal: Target, first: Float, user: Placing, runs: Sequence[Run]) -> Float:
    """Speed (n,) rad/s within which friction reverses, chosen so that each joint follows best; NaN: the user's.

    ``first`` (n,) is tried first.
    """
    best, least = np.full(len(goal.friction), np.nan), _errors(goal, user, runs)
    for factor in WIDTHS:
        tried = np.where(np.isnan(best), first, best) * factor
        after = _errors(replace(goal, turnover=tried), user, runs)
        better = after < least
        best, least = np.where(better, tried, best), np.where(better, after, least)
    return best


def _errors(goal: Target, user: Placing, runs: Sequence[Run]) -> Float:
    """Roll-out error (n,) rad rms of a file with the numbers of ``goal``."""
    with tempfile.TemporaryDirectory() as folder:
        written = write(user.simulator, goal, Path(folder))
        return rms_of(rolled_out(written.path, user.simulator.joints, runs))


def _goal(found: Explained, solution: Solution, user: Placing) -> Target:
    return replace(target_of(user, solution, found.model.baseline.mounted), servo=_servo(solution))
