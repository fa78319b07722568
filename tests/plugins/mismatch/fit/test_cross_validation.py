import numpy as np
import pytest

from cellwatt_plugins.mismatch.fit.cross_validation import (
    BLOCK,
    FOLDS,
    CrossValidation,
    blocks_of,
    confirmed_share,
    rms,
)
from cellwatt_plugins.mismatch.fit.problem import Problem, Term, torque_problem
from cellwatt_plugins.mismatch.input.moved import moved
from cellwatt_plugins.robot.effects import BY_NAME
from cellwatt_plugins.robot.effects.states import States
from tests.plugins.mismatch import plant

OFFSET = Term(BY_NAME["torque_offset"], 0, ())
"""At the vertical axis, where no nominal parameter gives way."""


@pytest.fixture(scope="module")
def problem(tmp_path_factory) -> Problem:
    arm = plant.load(plant.write_robot(tmp_path_factory.mktemp("plant")))
    shifted = plant.Missing(read=lambda torque: torque + np.array([2.0, 0, 0]))
    runs = [plant.record("run_01", 1, shifted, 12.0), plant.record("run_02", 2, shifted, 17.0)]
    states = [States(r.name, i, r.time, moved(r), arm) for i, r in enumerate(runs)]
    return torque_problem(runs, states)


def test_each_quarter_of_the_time_is_left_out_once(problem):
    fold = blocks_of(problem) % FOLDS
    assert len(fold) == len(problem.design.target)
    assert set(fold) == set(range(FOLDS))
    shares = np.bincount(fold) / len(fold)
    assert shares.min() > 0.1
    assert shares.max() < 0.4


def test_blocks_are_seconds_long_so_that_neighbours_tell_nothing(problem):
    lengths = []
    for part in problem.split(blocks_of(problem)):
        edges = np.flatnonzero(np.diff(part)) + 1
        lengths += list(np.diff([0, *edges, len(part)]) * problem.rows[0].step)
    assert min(lengths) > 0.5 * BLOCK


def test_the_residual_of_a_row_is_from_the_fit_without_its_fold(problem):
    """Ridge regression on the other rows alone, by the normal equations of all channels."""
    held = CrossValidation(problem, np.full(plant.JOINTS, 2.0))
    got = held.residual([OFFSET])
    blocks = [*problem.design.blocks, problem.block(OFFSET)]
    rows, channels = problem.design.target.shape
    columns = np.zeros((rows, channels, sum(b.size for b in blocks)))
    prior, at = [], 0
    for block in blocks:
        for channel in range(channels):
            own = block.of(channel)
            if own is not None:
                columns[:, channel, at : at + block.size] = own
        at += block.size
        prior.append(block.prior)
    precision = np.zeros((at, at))
    start = 0
    for p in prior:
        size = len(p.mean)
        precision[start : start + size, start : start + size] = np.linalg.inv(p.covariance)
        start += size
    weight = problem.design.root**2 / 2.0
    for fold in range(FOLDS):
        left = held.fold == fold
        kept = np.where(left[:, None], 0.0, weight)
        information = precision + np.einsum("ncm,nc,nck->mk", columns, kept, columns)
        pull = np.einsum("ncm,nc,nc->m", columns, kept, problem.design.target)
        fitted = columns @ np.linalg.solve(information, pull)
        assert np.allclose(got[left], (problem.design.target - fitted)[left], atol=1e-4)


def test_a_real_term_lowers_the_held_out_error_to_the_noise(problem):
    held = CrossValidation(problem, np.full(plant.JOINTS, 2.0))
    before, after = rms(held.residual([])), rms(held.residual([OFFSET]))
    assert before[0] > 1.2
    assert after[0] < 1.3 * plant.TORQUE_NOISE[0]
    assert np.all(after[1:] <= 1.05 * before[1:])


def test_a_term_of_pure_chance_does_not_lower_it(problem):
    """A push that never was gains nothing on rows that it was not fitted to."""
    held = CrossValidation(problem, np.full(plant.JOINTS, 2.0))
    chance = [Term(BY_NAME["external_contact"], 2, (0.0, 6.0, 0.1))]
    assert rms(held.residual(chance))[2] >= rms(held.residual([]))[2] - 1e-3


def test_a_simulated_effect_counts_as_far_as_other_runs_confirm_it(problem):
    """A spring that rings as simulated in both runs, and one that rings the other way in the first."""
    term = Term(BY_NAME["joint_elasticity"], 1, (4000.0, 8.0, 0.0))
    courses = problem.columns(term)
    nothing = np.zeros_like(problem.design.target)
    assert confirmed_share(problem, term, np.array([1.0, 0.0, 0.0]), nothing) == pytest.approx(1.0, abs=0.05)
    other_way = problem.stack([-2 * courses[0][:, :, 0], np.zeros_like(courses[1][:, :, 0])])
    assert confirmed_share(problem, term, np.array([1.0, 0.0, 0.0]), other_way) < 0.3


def test_sums_by_block_are_over_the_rows_of_each_block(problem):
    held = CrossValidation(problem, np.full(plant.JOINTS, 2.0))
    course = np.random.default_rng(3).normal(size=problem.design.target.shape)
    sums = held.by_block(course)
    numbers = blocks_of(problem)
    assert len(sums) == numbers.max() + 1 == round(12.0 / BLOCK) + round(17.0 / BLOCK)
    np.testing.assert_allclose(sums[4], course[numbers == 4].sum(axis=0))
