"""``robot.yaml``."""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress

from cellwatt.errors import ConfigError
from cellwatt_plugins.robot.description import load_robot
from fuzz.target import Target, folder


def run(data: bytes) -> None:
    """As each command reads it."""
    path = folder() / "robot.yaml"
    path.write_bytes(data)
    try:
        load_robot(path)
    except ConfigError as error:
        assert len(str(error)) < 3000
    with suppress(ConfigError):
        load_robot(path.parent)


def seeds() -> Iterable[bytes]:
    """A robot of two joints with all keys, and one with YAML's odder values."""
    yield (
        b"robot: r\nurdf: r.urdf\nsample_rate: 500\nstandby_power: 90\nconverter_efficiency: 0.9\nregeneration: 0.5\n"
        b"tolerances: {friction: 0.1, torque_gain: null}\nfloor: 0.0\npayload: 10\nbrakes: no\ntorque_from: current\n"
        b"capsules: [{link: 1, from: [0, 0, 0], to: [0, 0, 1], radius: 0.1}]\njoints:\n"
        b"- {name: a, gear_ratio: 100, torque_constant: 12.5, rotor_inertia: 1e-1, winding_resistance: 1.5,\n"
        b"   lower_limit: -3, upper_limit: 3, velocity_limit: 2}\n"
        b"- {name: b, coulomb_friction: 5, viscous_friction: 1, rated_torque: 9, torque_constant: 1,"
        b" winding_resistance: 1}\n"
    )
    yield b"robot: 2001-01-01\nurdf: !!binary aGk=\njoints: &a [{name: !!str 1, gear_ratio: .inf}, *a]\n? [1]\n: 0x1f\n"


TARGET = Target(run, seeds, 2048)
