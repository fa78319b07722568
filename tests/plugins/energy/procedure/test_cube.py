import numpy as np
import pytest

from tests.plugins.energy.procedure.cube import CUBES

SIDE = {"UR5e": 0.4, "UR10e": 0.8, "FR3": 0.4, "Gen3": 0.4}


@pytest.mark.parametrize("robot", list(SIDE))
def test_the_points_are_the_corners_of_a_plane_through_the_cube(robot):
    path, side = CUBES[robot].path, SIDE[robot]
    assert np.ptp(path, axis=0) == pytest.approx([side] * 3)
    legs = np.linalg.norm(np.diff(path[1:5], axis=0), axis=1)
    assert legs == pytest.approx([np.sqrt(2) * side, side, np.sqrt(2) * side])
    assert path[0] == pytest.approx((path[4] + path[1]) / 2)
    np.testing.assert_array_equal(path[0], path[5])
