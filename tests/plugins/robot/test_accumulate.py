import numpy as np
import pytest

from cellwatt_plugins.robot.accumulate import Accumulated


def test_integrals_between_any_times():
    sums = Accumulated(0.0, 0.1, np.array([1.0, 3.0, 5.0]))
    # Each sample holds for 0.05 s either side: −0.05 … 0.25.
    assert sums.between(np.array([-0.05]), np.array([0.25])) == pytest.approx([0.9])
    assert sums.between(np.array([0.0, 0.02]), np.array([0.1, 0.04])) == pytest.approx([0.2, 0.02])


def test_several_columns():
    sums = Accumulated(1.0, 0.5, np.array([[1.0, 2.0], [1.0, 4.0]]))
    assert sums.between(np.array([0.75]), np.array([1.75])) == pytest.approx(np.array([[1.0, 3.0]]))


def test_outside_the_recording_the_first_and_last_sample_go_on():
    sums = Accumulated(0.0, 0.1, np.array([1.0, 3.0, 5.0]))
    assert sums.between(np.array([-1.05]), np.array([-0.05])) == pytest.approx([1.0])
    assert sums.between(np.array([0.25]), np.array([1.25])) == pytest.approx([5.0])
