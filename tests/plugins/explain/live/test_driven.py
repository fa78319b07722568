"""A cell whose robot tells target and actual positions, and no torque: the law of its servos stands for it."""

from __future__ import annotations

import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from cellwatt.errors import ConfigError
from cellwatt.results import Prediction
from cellwatt_plugins.explain.command import explain
from cellwatt_plugins.explain.live.recording import write_recording, write_robot
from tests.blocks import layout_of
from tests.calling import called
from tests.plugins.explain.emulated_arm import START, framed
from tests.plugins.explain.servos import PLANTS, ROW, Plant, integrated, mjcf, moves
from tests.plugins.explain.test_stage import alarms, made, run

pytest.importorskip("mujoco")


@pytest.fixture(scope="module")
def logs():
    plants = {"null": PLANTS["null"], "gain": PLANTS["gain"], "rough": Plant(coulomb=(6.0, 1.0))}
    return dict(zip(plants, integrated(list(plants.values()), moves(7)), strict=True))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.xml").write_text(mjcf())
    return folder


def frames(log, every=1):
    _, told, seen = (values[::every] for values in log)
    units = {f"arm.joint_{j}.{q}": "rad" for q in ("position", "target_position") for j in (1, 2)}
    return framed(layout_of(units, 1 / ROW / every), np.column_stack([seen, told]))


def watched(folder, log, every=1, **settings):
    whole = frames(log, every=every)
    stage = made(folder, whole.layout, robot="arm.xml", **settings)
    return stage, run(stage, whole)


def told(results):
    return {(alarm.kind, alarm.joint) for alarm in alarms(results)}


def test_an_arm_that_follows_its_file_is_left_alone(folder, logs):
    stage, results = watched(folder, logs["null"])
    assert told(results) == set()
    assert stage.counts["intervals judged"] >= 5
    assert "arm.joint_2.torque" in next(r for r in results if isinstance(r, Prediction)).outputs


def test_a_cell_that_samples_commands_less_often_is_told_their_rate(folder, logs):
    assert told(watched(folder, logs["null"], every=2, command_rate=1 / ROW)[1]) == set()
    assert told(watched(folder, logs["gain"], every=2, command_rate=1 / ROW)[1]) == {("simulation_differs", 2)}
    assert told(watched(folder, logs["null"], every=2)[1]), "commands are taken to hold for two rows"


@pytest.mark.parametrize(("plant", "joint"), [("gain", 2), ("rough", 1)])
def test_a_soft_loop_and_friction_raise_the_alarm_of_their_joint(folder, logs, plant, joint):
    assert told(watched(folder, logs[plant])[1]) == {("simulation_differs", joint)}


def test_what_it_keeps_is_explained_and_the_model_agrees_with_the_arm(folder, logs, tmp_path):
    stage, _ = watched(folder, logs["gain"])
    time, rows = stage._history.between(0, 2**62)
    write_recording(tmp_path / "recording.parquet", stage._intake, time, rows)
    seen = pq.read_table(tmp_path / "recording.parquet")
    assert seen.column_names == ["t", "q_1", "q_2", "command_1", "command_2"]
    first = round((time[0] - START) * 1e-9 / ROW)
    assert np.array_equal(seen["command_2"], logs["gain"][1][first : first + len(time), 1])
    write_robot(tmp_path / "robot.yaml", stage._simulation.model.robot)
    given = [str(tmp_path / "recording.parquet"), "--simulation", str(folder / "arm.xml")]
    given += ["--robot", str(tmp_path / "robot.yaml"), "--out", str(tmp_path), "--no-report", "-q"]
    called(explain, *given)
    found = json.loads((tmp_path / "findings.json").read_text())["findings"]
    assert [(f["effect"], f["joint"]) for f in found] == [("drive_gain", 2)]
    assert told(watched(folder, logs["gain"], simulation=str(tmp_path / "model.yaml"))[1]) == set()


def test_an_arm_without_torque_needs_the_law_of_its_servos(folder, logs):
    file = mjcf()
    (folder / "motors.xml").write_text(file[: file.index("<actuator>")] + "</mujoco>")
    with pytest.raises(
        ConfigError, match="set `robot` to an MJCF with a <position> actuator for each of shoulder, elbow"
    ):
        made(folder, frames(logs["null"]).layout, robot="motors.xml")
