from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.explain.fit.solution import Solution
from cellwatt_plugins.explain.fit.swinging_links import (
    chi2_at_rest,
    remaining_chi2,
    swinging_channels,
    swinging_torque,
)
from cellwatt_plugins.explain.verdict.lack_of_fit import lack_of_fit
from cellwatt_plugins.robot.effects import BY_NAME
from tests.plugins.explain import plant

SWINGS = Term(BY_NAME["joint_elasticity"], 1, (900.0, 0.5, 0.0))


@pytest.fixture(scope="module")
def problem(arm):
    return plant.problem_of(arm)


def solved(problem, residual, terms=(SWINGS,)):
    """As if the fit had left ``residual`` beside terms of their full size."""
    blocks = [problem.block(term) for term in terms]
    ends = np.cumsum([0, *(block.size for block in blocks)])
    slices = [slice(a, b) for a, b in pairwise(ends)]
    fit = SimpleNamespace(residual=residual, blocks=blocks, slices=slices, coefficients=np.ones(ends[-1]))
    return Solution(problem, list(terms), fit, np.ones(plant.JOINTS))


def swing(problem):
    """What the link adds at its own joint, (N,) Nm."""
    return problem.block(SWINGS).columns[:, 1, 0]


def test_a_swinging_link_shakes_its_joint_and_those_that_carry_it(problem):
    found = solved(problem, np.zeros_like(problem.design.target))
    np.testing.assert_allclose(swinging_torque(found), problem.block(SWINGS).columns.sum(axis=2))
    assert 1 in swinging_channels(found)


def test_what_is_left_while_it_swings_is_its_own(problem):
    """The same residual, once while the link swings and once between."""
    course, noise = swing(problem), problem.floor[1]
    swings = np.abs(course) > 0.3 * noise
    assert 0.05 < np.mean(swings) < 0.95
    for when, excess in ((swings, False), (~swings, True)):
        residual = np.random.default_rng(1).normal(size=problem.design.target.shape) * problem.floor
        residual[when, 1] += 6 * noise * np.sign(np.sin(np.arange(when.sum())))
        found = solved(problem, residual)
        assert (chi2_at_rest(found)[1] > 1.35) == excess
        named = [u.channel for u in lack_of_fit(problem.chi2(residual), found)]
        assert named == ([1] if excess else [])


def test_next_to_a_swinging_link_bare_noise_counts(problem):
    """Near stops a sample is not known well; there the shaking of a neighbour is not to hide."""
    wide = np.sqrt(np.concatenate(problem.variance))
    found = solved(problem, 0.9 * wide)
    bare = np.mean(np.square(0.9 * wide), axis=0) / problem.floor**2
    assert swinging_channels(found) - {1}
    for channel in range(plant.JOINTS):
        by_variance = pytest.approx(0.81, rel=1e-6)
        neighbour = channel in swinging_channels(found) - {1}
        assert remaining_chi2(found)[channel] == (pytest.approx(max(bare[channel], 0.81)) if neighbour else by_variance)
