"""The arms that models are judged on share no code with the models."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.bench.independent import imported

ROOT = Path(__file__).resolve().parents[3]
ARMS = (
    "bench/energy/chain.py",
    "bench/models/held_arms.py",
    "tests/plugins/models/static/arms.py",
    "tests/plugins/models/power/emulated_arm.py",
)
ALLOWED = {"__future__", "dataclasses", "energy.chain", "mujoco", "numpy", "pathlib", "pyarrow", "yaml"}
"""Nothing of cellwatt, nor Pinocchio, by which the models reckon."""


@pytest.mark.parametrize("file", ARMS)
def test_an_emulated_arm_has_physics_of_its_own(file):
    names = imported((ROOT / file).read_text()) - ALLOWED
    assert {name.split(".")[0] for name in names} <= ALLOWED


def test_the_check_sees_what_is_shared():
    assert "cellwatt_plugins.robot" in imported("def f():\n    from cellwatt_plugins.robot import Body\n")
    assert "." in imported("from . import arms")
