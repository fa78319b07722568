"""A URDF."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress

import numpy as np

from cellwatt.errors import ConfigError
from cellwatt_plugins.robot.body import Body
from fuzz.target import Target, folder


def run(data: bytes) -> None:
    """As the arm of a description with one joint, and with two."""
    path = folder() / "robot.urdf"
    path.write_bytes(data)
    for joints in (("a",), ("a", "b")):
        with suppress(ConfigError):
            body = Body(path, joints)
            zero = np.zeros((1, body.joints))
            assert body.inverse_dynamics(zero, zero, zero).shape == zero.shape


def seeds() -> Iterable[bytes]:
    """An arm of two links with masses, one joint of them without limits."""
    link = '<link name="{}"><inertial><origin xyz="0 0 .1"/><mass value="2"/>' \
        '<inertia ixx=".1" ixy="0" ixz="0" iyy=".1" iyz="0" izz=".1"/></inertial></link>'  # fmt: skip
    joint = (
        '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/><origin xyz="0 0 .3" rpy="0 0 0"/>'
        '<axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="2" effort="9"/></joint>'
    )
    links = "".join(link.format(name) for name in "xyz")
    first = joint.format("a", "revolute", "x", "y")
    yield f'<robot name="r">{links}{first}{joint.format("b", "continuous", "y", "z")}</robot>'.encode()
    yield f'<robot name="r">{links}{first}{joint.format("b", "fixed", "y", "z")}</robot>'.encode()


TARGET = Target(run, seeds, 2048)
