"""References, power equations and explained models: YAML that a person may have changed."""

from __future__ import annotations

from collections.abc import Iterable

from cellwatt.errors import ConfigError, ModelError
from cellwatt_plugins.explain.model import load_model
from cellwatt_plugins.faults import reference
from cellwatt_plugins.faults.paper import equation
from fuzz.target import Target, folder


def run(data: bytes) -> None:
    """As each kind of file; a reference that was read is saved, and reads as the same."""
    path = folder() / "reference.yaml"
    path.write_bytes(data)
    for read in (equation.load, load_model):
        try:
            read(path)
        except (ModelError, ConfigError) as error:
            assert len(str(error)) < 3000
    try:
        found = reference.load(path)
    except ModelError as error:
        assert len(str(error)) < 3000
        return
    reference.save(found, path)
    again = reference.load(path)
    reference.save(again, path)
    assert str(reference.load(path)) == str(again)


def seeds() -> Iterable[bytes]:
    """A reference of one task with a whole cycle; an equation; a model's head."""
    pattern = b"{start: -0.2, step: 0.02, mean: [1.0, 2.0], spread: [0.1, 0.1]}"
    yield (
        b"cellwatt_reference: 1\nrobot: null\narm: arm\npower: supply.power\njoints: 1\ntasks:\n- name: task_1\n"
        b"  signature: 1+5\n  variants:\n  - speed: 1.0\n    cycles: 7\n    intervals:\n    - moving: [1]\n"
        b"      pose: [0.0]\n      displacement: [0.5]\n      duration: 0.7\n      rest: 0.2\n      cycles: 7\n"
        b"      power: " + pattern + b"\n      position:\n        1: " + pattern + b"\n"
        b"cycles:\n- {task: task_1, speed: 1.0, cycles: 8, step: 0.02, moves: [[0.0, 0.03]], repeat: [0.1],"
        b" power: [1, 2], spread: [1, 1], position: {1: [0, 1]}}\n"
    )
    yield b"cellwatt_power_equation: 1\npower: P\norder: 1\nduration: 2.0\nrms: [1.0]\nK: 1\np: [[1, 0]]\nr: [[1, 0]]\n"
    yield b"format: 2\nrobot: {robot: r, urdf: r.urdf, joints: [{name: a}]}\nretuned: {inertial: [0]}\neffects: []\n"


TARGET = Target(run, seeds, 2048)
