from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cellwatt_plugins.explain.fit.acceptance import sound, unconfirmed
from cellwatt_plugins.explain.fit.problem import Problem, Term
from cellwatt_plugins.explain.fit.solution import Solution
from cellwatt_plugins.explain.fit.thresholds import DEFAULT, Thresholds
from cellwatt_plugins.robot.effects import BY_NAME
from tests.plugins.explain import plant

OFFSET = Term(BY_NAME["torque_offset"], 0, ())
RIPPLES = [Term(BY_NAME["position_periodic_torque"], joint, (n,)) for joint, n in ((0, 11.3), (1, 17.7), (2, 23.4))]


@pytest.fixture(scope="module")
def problem(arm) -> Problem:
    shifted = plant.Missing(read=lambda torque: torque + np.array([0.1, 0, 0]))
    return plant.problem_of(arm, shifted, 20.0, (1, 2, 3))


def solved(problem: Problem, *terms: Term) -> Solution:
    fit = problem.fit([problem.block(term) for term in terms], None)
    return Solution(problem, list(terms), fit, problem.factor(fit.residual))


def judged(problem: Problem, *terms: Term, thresholds: Thresholds = DEFAULT) -> str | None:
    """Why data left out do not confirm the last of the terms."""
    before = solved(problem, *terms[:-1])
    gain = before.fit.gain(problem.block(terms[-1]))[0]
    return unconfirmed(before, solved(problem, *terms), terms[-1], thresholds, gain)


def test_a_small_real_term_holds_near_the_noise(problem):
    """An offset of less than a third of the noise, in all runs."""
    assert judged(problem, OFFSET) is None


@pytest.mark.parametrize("ripple", RIPPLES, ids=lambda t: f"joint {t.joint + 1}, {t.shape[0]} a turn")
def test_a_ripple_that_is_not_there_does_not(problem, ripple):
    assert judged(problem, OFFSET, ripple) is not None


@pytest.mark.parametrize(("centre", "right"), [(0.3, True), (1.8, False)])
def test_a_load_far_from_the_flange_is_none(problem, centre, right):
    coefficients = np.array([2.0, 0.0, 0.0, 2.0 * centre, *np.zeros(6)])
    assert BY_NAME["payload"].sensible(coefficients, (), problem.states[0].robot, None) == right


@pytest.mark.parametrize(
    ("size", "described", "found", "right"),
    [(0.5, 0.0, False, True), (-0.5, 0.0, False, False), (-0.5, 2.0, False, True), (-0.5, 0.0, True, True)],
)
def test_friction_grows_less_than_speed_only_where_some_grows_with_it(problem, size, described, found, right):
    slower, viscous = Term(BY_NAME["nonlinear_viscous_friction"], 0, (2.0,)), Term(BY_NAME["viscous_friction"], 0, ())
    robot = problem.states[0].robot
    joints = (robot.joints[0].model_copy(update={"viscous_friction": described}), *robot.joints[1:])
    states = SimpleNamespace(robot=robot.model_copy(update={"joints": joints}))
    solution: Any = SimpleNamespace(
        problem=SimpleNamespace(states=[states]),
        terms=[slower, viscous] if found else [slower],
        coefficients=lambda term: np.array([size]),
    )
    assert sound(solution, slower) == right


@pytest.mark.parametrize(("cycles", "right"), [(3.1, True), (4.3, False), (8.0, True), (23.4, True)])
def test_few_ripples_a_turn_are_a_whole_number_of_them(cycles, right):
    assert BY_NAME["position_periodic_torque"].closed((cycles,)) == right


def test_samples_that_tell_little_do_not_hide_what_is_left(problem):
    """Half of the samples near stops, where friction may pull either way and 100 times the noise would be none."""
    unsure = tuple(np.where(np.arange(len(v))[:, None] % 2, 1e4, 1.0) * problem.floor**2 for v in problem.variance)
    doubtful = replace(problem, variance=unsure)
    left = 3.0 * np.random.default_rng(1).normal(size=problem.design.target.shape) * problem.floor
    assert doubtful.chi2(left) == pytest.approx(9.0, rel=0.1)
    assert doubtful.fast_chi2(left) == pytest.approx(9.0, rel=0.15)


def test_samples_that_tell_little_refuse_no_term_with_much_evidence(problem):
    """One in 50 samples, near stops, is off by 30 times the noise, and a real offset makes these worse."""
    rows = [np.arange(len(v))[:, None] % 50 == 0 for v in problem.variance]
    variance = tuple(
        np.where(near, (100 * problem.floor) ** 2, v) for near, v in zip(rows, problem.variance, strict=True)
    )
    target = tuple(np.where(near, -30 * problem.floor, t) for near, t in zip(rows, problem.target, strict=True))
    doubtful = replace(problem, target=target, variance=variance, of_design={})
    assert judged(doubtful, OFFSET, thresholds=replace(DEFAULT, clear=32.0)) is None
    assert judged(doubtful, OFFSET) is not None
