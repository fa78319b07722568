"""Files behind the settings of a stage: a reload applies the one that was written again, whichever names it."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from cellwatt.config import load
from cellwatt.runtime.change import Change

CELL = """
site: a
cell: b
robot: ./robots/arm
sources: {arm: {driver: ur, host: h}}
stages:
  faults: {reference: reference.yaml, robot: robots/arm}
  energy: {robot: robots/arm/robot.yaml, balance: energy.json}
  mismatch: {simulation: found}
  segment: {}
"""
FILES = {
    "robots/arm/robot.yaml": "robot: arm\nurdf: ../shapes/arm.urdf\n",
    "robots/shapes/arm.urdf": "<robot/>",
    "found/model.yaml": "format: 1\n",
    "reference.yaml": "tasks: []\n",
}


@pytest.mark.parametrize(
    ("file", "changed"),
    [
        ("robots/shapes/arm.urdf", ["faults", "energy", "mismatch"]),
        ("robots/arm/robot.yaml", ["faults", "energy", "mismatch", "segment"]),
        ("found/model.yaml", ["mismatch"]),
        ("reference.yaml", ["faults"]),
    ],
)
def test_a_file_that_was_written_again(tmp_path: Path, file: str, changed: list[str]) -> None:
    for name, text in {"cell.yaml": CELL, **FILES}.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    before = load(tmp_path / "cell.yaml")
    os.utime(tmp_path / file, (1, 1))
    assert Change.between(before, load(tmp_path / "cell.yaml")).stages == changed
    (tmp_path / "robots/arm/robot.yaml").write_text("robot: [\n")
    load(tmp_path / "cell.yaml")
