"""The pose of least gravity on arms whose gravity the plant computes on its own."""

from dataclasses import replace

import numpy as np
import pytest
from energy.chain import Link, torques, write_robot

from cellwatt.errors import ConfigError
from cellwatt_plugins.energy.procedure.rest_pose import rest_pose
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.collision import CLEARANCE, Checker

THIN = (0.01, 0.01, 0.01)
ROD = 0.4


def arm_of(folder, ranges):
    """Shoulder and elbow about y, two links of 0.4 m along x at zero; a third joint about the vertical below them."""
    links = (
        Link((0, 0, 0.3), (0, 0, 1), 2.0, (0, 0, 0), THIN),
        Link((0, 0, 0), (0, 1, 0), 3.0, (ROD / 2, 0, 0), THIN),
        Link((ROD, 0, 0), (0, 1, 0), 2.0, (ROD / 2, 0.02, 0), THIN),
    )
    low, high = zip(*ranges, strict=True)
    write_robot(folder, links, {"lower_limit": low, "upper_limit": high}, robot="planar")
    arm = Arm.load(folder)
    limits = arm.finite_limits()
    return links, arm, limits, Checker(arm, limits)


def gravity(links, q):
    still = np.zeros((1, len(q)))
    return torques(links, q[None, :], still, still)[0]


def brute(links, limits, count=181):
    """Least ‖G‖ on a grid of shoulder and elbow; the vertical axis feels nothing."""
    shoulder, elbow = (np.linspace(*limits[i], count) for i in (1, 2))
    grid = np.array([(0.0, a, b) for a in shoulder for b in elbow])
    still = np.zeros_like(grid)
    return float(np.linalg.norm(torques(links, grid, still, still), axis=1).min())


def test_the_least_of_several_minima_within_the_limits(tmp_path):
    """The shoulder cannot stand the arm up: the elbow must balance it; a grid knows how well."""
    links, arm, limits, _ = arm_of(tmp_path, [(-3, 3), (-1.2, 0.3), (-2.0, 2.0)])
    found = rest_pose(arm, starts=16)
    assert np.all((found.q >= limits[:, 0]) & (found.q <= limits[:, 1]))
    assert found.residual == pytest.approx(np.linalg.norm(gravity(links, found.q)), rel=1e-6)
    assert found.residual <= brute(links, limits) + 0.02
    assert found.residual > 1.0


def test_not_through_the_floor(tmp_path):
    """Hanging down asks nothing of the motors, but the floor is there."""
    links, arm, _, checker = arm_of(tmp_path, [(-3, 3), (0.2, 3.0), (-2.5, 2.5)])
    found = rest_pose(arm, starts=16)
    assert found.clearance >= CLEARANCE
    assert checker.safe(found.q[None]).all()
    hanging = np.array([0.0, np.pi / 2, 0.0])
    assert np.linalg.norm(gravity(links, hanging)) < 1e-6
    assert not checker.safe(hanging[None]).any()


def test_no_clear_pose_is_told(tmp_path):
    _, arm, _, _ = arm_of(tmp_path, [(-3, 3), (-0.2, 0.2), (-0.2, 0.2)])
    high = replace(arm, description=arm.description.model_copy(update={"floor": 2.0}))
    with pytest.raises(ConfigError, match="no pose of least gravity is clear"):
        rest_pose(high, starts=4)
