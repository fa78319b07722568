"""One table with other names and units than the usual ones: every command opens it, and reads the same."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from cellwatt.emulation import load_signals
from cellwatt.tables import names, read_table
from cellwatt_plugins.energy.recordings import read_motion, read_reading
from cellwatt_plugins.explain.input.signals import read_signals
from cellwatt_plugins.faults.recordings import frames_of_files
from cellwatt_plugins.models import Input
from cellwatt_plugins.models.power.moves import read_moves
from cellwatt_plugins.models.predict import inputs_of
from cellwatt_plugins.models.static.poses import read_poses
from cellwatt_plugins.robot import Joint, RobotDescription
from cellwatt_plugins.robot.meter.file import _read as read_meter
from tests.plugins.models.making import metadata

STEP, COUNT = 0.02, 2000
TIME = STEP * np.arange(COUNT)
POSE = np.repeat(np.arange(20), 100)
"""Twenty poses, so that what recognises held ones has some."""
Q = np.column_stack([0.1 * POSE, np.sin(TIME)])
QD = np.column_stack([np.zeros(COUNT), np.cos(TIME)])
TAU = np.column_stack([5.0 + np.sin(2 * TIME), -TIME])
POWER = 90.0 + np.sin(3 * TIME)
TABLE = {
    "Time [ms]": 1e3 * TIME,
    "q1_deg": np.degrees(Q[:, 0]),
    "Q 2 (mrad)": 1e3 * Q[:, 1],
    "joint_1.velocity [deg/s]": np.degrees(QD[:, 0]),
    "joint_2_velocity": QD[:, 1],
    "torque_1 [mNm]": 1e3 * TAU[:, 0],
    "torque_2": TAU[:, 1],
    "actual_current_0": TAU[:, 0] / 10,
    "actual_current_1": TAU[:, 1] / 10,
    "temperature_1 [K]": np.full(COUNT, 313.15),
    "temperature_2": np.full(COUNT, 40.0),
    "supply_power [kW]": 1e-3 * POWER,
    "pose": POSE,
    "operator": ["Ann"] * COUNT,
}
ROBOT = RobotDescription(robot="arm", urdf=Path("arm.urdf"), joints=(Joint(name="joint_1"), Joint(name="joint_2")))


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The table as a CSV file with semicolons and decimal commas."""
    file = tmp_path_factory.mktemp("tables") / "run.csv"
    rows = [";".join(str(cell).replace(".", ",") for cell in row) for row in zip(*TABLE.values(), strict=True)]
    file.write_text("\n".join([";".join(TABLE), *rows]) + "\n")
    return file


def explain(path: Path) -> list[Any]:
    found = read_signals(path, ROBOT)
    assert np.allclose(found.joints["temperature"], 40.0)
    return [found.time, found.needed("position"), found.joints["velocity"], found.needed("torque"), found.power]


def faults(path: Path) -> list[Any]:
    values = np.concatenate([frames.values for frames in frames_of_files([path])])
    return [TIME, values[:, :2], QD, TAU, values[:, 2]]


def disaggregate(path: Path) -> list[Any]:
    motion, reading = read_motion(path, ROBOT.names), read_reading(path)
    return [motion.time, motion.position, motion.velocity, motion.torque, reading.power]


def train_power(path: Path) -> list[Any]:
    moves = read_moves([path], ROBOT.names)
    return [moves.time, moves.q, moves.qd, 10 * moves.current, moves.power]


def predict(path: Path) -> list[Any]:
    asked = [Input(f"joint_{j}.{quantity}", "rad") for quantity in ("position", "velocity", "torque") for j in (1, 2)]
    found = inputs_of(metadata(inputs=(*asked, Input("supply.power", "W"))), read_table(path))
    return [TIME, found[:, :2], found[:, 2:4], found[:, 4:6], found[:, 6]]


def slow_meter(path: Path) -> list[Any]:
    readings = read_meter(path, STEP / 3)
    return [readings.time, Q, QD, TAU, readings.value]


@pytest.mark.parametrize("command", [explain, faults, disaggregate, train_power, predict, slow_meter])
def test_every_command_reads_the_same(path: Path, command: Callable[[Path], list[Any]]) -> None:
    for found, truth in zip(command(path), [TIME, Q, QD, TAU, POWER], strict=True):
        np.testing.assert_allclose(found, truth, atol=1e-6)


def test_train_static_reads_the_same(path: Path) -> None:
    poses = read_poses([path], ROBOT)
    first = Q.reshape(20, 100, 2).mean(axis=1)
    np.testing.assert_allclose(poses.q, first)
    np.testing.assert_allclose(poses.torque, TAU.reshape(20, 100, 2).mean(axis=1))


def test_emulate_takes_the_columns_by_their_own_names(path: Path) -> None:
    signals = load_signals(path)
    np.testing.assert_allclose(signals.columns["Q 2 (mrad)"], 1e3 * Q[:, 1])
    np.testing.assert_allclose(signals.time, TIME)


def test_the_page_lists_every_name() -> None:
    page = (Path(__file__).parents[2] / "docs" / "tables.md").read_text().casefold()
    numbered = [stem for stems in names.JOINT.values() for stem in stems]
    assert [stem for stem in numbered if f"`{stem}_0`" not in page and f"`{stem}_1`" not in page] == []
    assert all(f"`{name}`" in page for stems in names.WHOLE.values() for name in stems)
