"""A tilt that the search finds beside another mount is part of the mount."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from cellwatt_plugins.explain.verdict.findings import Finding, Improvement, Where
from cellwatt_plugins.explain.verdict.mounting import Mounting
from cellwatt_plugins.robot.effects.effect import Parameter

DOWN = np.array([0.0, 0.0, -9.81])
MOUNT = np.array([0.0, 6.9, -6.97])


def finding(effect: str, **parameters: Parameter) -> Finding:
    error = Improvement("tau_2", "N*m", 3.0, 0.5, 0.4, False)
    return Finding(effect, None, "missing", 0.99, f"{effect}.", parameters, Where(("tau_2",)), error)


MOUNTED = finding(
    "gravity_tilt",
    **{f"gravity_{axis}": Parameter(g, 0.3, "m/s^2") for axis, g in zip("xyz", MOUNT.tolist(), strict=True)},
)
OFFSET = replace(finding("torque_offset", offset=Parameter(2.0, 0.1, "N*m")), joint=1)


def test_the_direction_of_gravity_is_one_finding():
    lean = 0.08
    tilt = finding("gravity_tilt", roll=Parameter(lean, 0.002, "rad"), yaw=Parameter(0.0, 0.003, "rad"))
    mounted, *others = Mounting(MOUNTED, DOWN, np.ones(3)).with_tilt([MOUNTED, OFFSET, tilt])
    assert others == [OFFSET]
    true = Rotation.from_rotvec([-lean, 0, 0]).apply(MOUNT)
    found = [each.value for each in mounted.parameters.values()]
    assert found == pytest.approx(true, abs=0.02)
    assert np.linalg.norm(found) == pytest.approx(9.81)
    assert "not (0.00, 0.00, -9.81)" in mounted.statement
    assert max(each.std for each in mounted.parameters.values()) < 0.03


def test_without_a_tilt_the_mount_is_said_as_it_was_found():
    assert Mounting(MOUNTED, DOWN, np.ones(3)).with_tilt([MOUNTED, OFFSET]) == [MOUNTED, OFFSET]
