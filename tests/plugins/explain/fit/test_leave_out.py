from dataclasses import replace

import numpy as np
import pytest

from cellwatt_plugins.explain.fit.leave_out import FOLDS, LeaveOut, compared, folds_of, rms
from cellwatt_plugins.explain.fit.problem import Problem, Term
from cellwatt_plugins.explain.fit.sides import torque_problem
from cellwatt_plugins.robot.effects import BY_NAME
from tests.plugins.explain import plant

OFFSET = Term(BY_NAME["torque_offset"], 0, ())
"""At the vertical axis, where no nominal parameter gives way."""
FACTOR = np.array([2.0, 3.0, 1.5])


@pytest.fixture(scope="module")
def problem(arm) -> Problem:
    shifted = plant.Missing(read=lambda torque: torque + np.array([2.0, 0, 0]))
    runs = [plant.record("run_01", 1, shifted, 20.0), plant.record("run_02", 2, shifted, 28.0)]
    return torque_problem(runs, plant.states_of(runs, arm))


@pytest.fixture(scope="module")
def held(problem) -> LeaveOut:
    return LeaveOut(problem, FACTOR)


def test_runs_of_one_motion_share_their_folds(problem):
    """A third run that makes the motion of the first again is left out with it."""
    runs = {name: getattr(problem, name) for name in ("states", "rows", "target")}
    again = replace(problem, **{name: (*parts, parts[0]) for name, parts in runs.items()})
    fold = folds_of(again)
    first, other, repeated = np.split(fold, np.cumsum([len(part) for part in problem.target]))
    np.testing.assert_array_equal(first, repeated)
    assert set(first) | set(other) == set(range(FOLDS))


def ridge(problem: Problem, left: np.ndarray) -> np.ndarray:
    """Residual (N, C) of the regression on the rows that are not ``left``, all channels' columns side by side."""
    blocks = [*problem.design.blocks, problem.block(OFFSET)]
    rows, channels = problem.design.target.shape
    size = sum(b.size for b in blocks)
    columns, precision = np.zeros((rows, channels, size)), np.zeros((size, size))
    at = 0
    for block in blocks:
        place = slice(at, at + block.size)
        for channel in range(channels):
            own = block.of(channel)
            if own is not None:
                columns[:, channel, place] = own
        precision[place, place] = np.linalg.inv(block.prior.covariance)
        at += block.size
    weight = np.where(left[:, None], 0.0, 1 / np.concatenate(problem.variance) / FACTOR)
    information = precision + np.einsum("ncm,nc,nck->mk", columns, weight, columns, optimize=True)
    pull = np.einsum("ncm,nc,nc->m", columns, weight, problem.design.target, optimize=True)
    return np.asarray(problem.design.target - columns @ np.linalg.solve(information, pull))


def test_residual_and_error_of_a_fold_are_of_the_regression_without_it(problem, held):
    left = held.fold == FOLDS - 1
    own = ridge(problem, left)[left]
    np.testing.assert_allclose(held.residual([OFFSET])[left], own, atol=1e-5)
    squares = np.sum(own**2 / np.concatenate(problem.variance)[left], axis=0)
    np.testing.assert_allclose(held.errors([OFFSET])[FOLDS - 1], squares, rtol=1e-4)


def test_a_real_term_lowers_the_error_to_the_noise(held):
    before, after = rms(held.residual([])), rms(held.residual([OFFSET]))
    assert before[0] > 1.2
    assert after[0] < 1.3 * plant.TORQUE_NOISE[0]
    assert np.all(after[1:] <= 1.05 * before[1:])
    found = compared(held.errors([]), held.errors([OFFSET]), [0])
    assert found.share > 0.9
    assert found.sure > 3
    assert found.rise < 0.01


def test_errors_are_compared_fold_by_fold_in_units_of_each_channels_own():
    before = np.array([[8.0, 200.0], [12.0, 100.0], [10.0, 300.0]])
    after = np.array([[6.0, 202.0], [9.0, 103.0], [6.0, 307.0]])
    found = compared(before, after, [0])
    # (2 + 3 + 4) of 30 leave; 0.3 ± 0.1 / √3 of the folds; channel 2 rises by 12 of 600.
    assert found.share == pytest.approx(0.3)
    assert found.sure >= 0.3 / (0.1 / np.sqrt(3)) - 1e-9
    assert found.rise == pytest.approx(0.02)
    assert found.again
    both = compared(before, after)
    assert both.share == pytest.approx(0.3 - 0.02)
