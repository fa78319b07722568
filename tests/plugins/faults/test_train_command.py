"""`cellwatt faults train`: fault tables and the paper's network, from recorded faults."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from cellwatt.emulation import ArmSignals
from cellwatt.errors import ModelError
from cellwatt.tables import write_table
from cellwatt_plugins.faults import train_command
from cellwatt_plugins.faults.command import faults, reference
from cellwatt_plugins.faults.paper.columns import column_of
from cellwatt_plugins.faults.paper.course import courses_of
from cellwatt_plugins.faults.paper.network import FaultNetwork
from cellwatt_plugins.faults.paper.stage import PaperFaultsStage
from cellwatt_plugins.faults.reference import load
from tests.plugins.faults.paper.irb1200 import POLISHING, Fault, Run, run
from tests.plugins.faults.watching import arm_frames, beside_another_arm, called, watch, write_recording

DEMO = Path(__file__).resolve().parents[3] / "examples" / "demo-reference.yaml"


def table(path, *faults_, seed, cycles=3):
    told = run(Run(POLISHING, cycles, 1.0, faults_, rate=50.0, lead=1.0, seed=seed))
    return write_recording(path, told.t, told.q, told.power)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    where = tmp_path_factory.mktemp("train")
    healthy = table(where / "healthy.parquet", seed=1, cycles=4)
    assert called(reference, healthy, "--out", where / "reference.yaml").exit_code == 0
    table(where / "calm.parquet", seed=3)
    for joint in range(1, 7):
        table(where / f"rubs_{joint}.parquet", Fault("friction", joint, 25.0), seed=20 + joint)
    return where


def train(folder, *more):
    return called(faults, "train", "--reference", folder / "reference.yaml", "--out", folder / "nets", *more)


def recorded(folder):
    return [word for j in range(1, 7) for word in ("--fault", f"{j}={folder / f'rubs_{j}.parquet'}")]


def test_a_table_is_learnt_from_recorded_faults_and_its_network_knows_others_like_them(folder):
    done = train(folder, *recorded(folder), folder / "calm.parquet", "--json")
    assert done.exit_code == 0, done.exception
    (network,) = json.loads(done.stdout)["networks"]
    assert all(column == {"origin": "recorded", "cycles": 3} for column in network["columns"])
    assert (network["healthy_cycles"], network["named_in_vain"]) == (3, 0)
    learnt = FaultNetwork(Path(network["file"]))
    assert learnt.signed
    assert learnt.task is not None
    assert learnt.task.joints == 6
    moving = np.array([[j in move.by for j in range(1, 7)] for move in POLISHING])
    assert (learnt.table[~moving] == 0).all()  # friction shows only where its joint moves
    assert (learnt.table[:, 4] == np.array([1, 0, 0, 0, 0, 0, 0, 0])).all()


def test_tables_with_columns_of_other_names_and_the_power_of_a_meter(folder, tmp_path):
    """Each --meter goes with a RECORDING or, after these, with a --fault."""
    words, meters = [], []
    for name in ["calm", *(f"rubs_{j}" for j in range(1, 7))]:
        told = pq.read_table(folder / f"{name}.parquet")
        write_table(tmp_path / f"{name}.csv", {"t": told["t"], **{f"Achse{j}": told[f"q_{j}"] for j in range(1, 7)}})
        write_table(tmp_path / f"{name}-meter.csv", {"t": told["t"], "power": told["power"]})
        words += [tmp_path / f"{name}.csv"] if name == "calm" else ["--fault", f"{name[-1]}={tmp_path / name}.csv"]
        meters += ["--meter", tmp_path / f"{name}-meter.csv"]
    done = train(folder, *words, *meters, "--columns", "q=Achse{}", "--json")
    assert done.exit_code == 0, done.exception
    (network,) = json.loads(done.stdout)["networks"]
    assert all(column == {"origin": "recorded", "cycles": 3} for column in network["columns"])
    assert network["healthy_cycles"] == 3
    done = train(folder, *words, *meters[:-2], "--columns", "q=Achse{}")
    assert "7 recordings but 6 meters" in str(done.exception)


@pytest.mark.parametrize("arms", [1, 2])
def test_a_joint_without_a_fault_is_told_in_one_line(folder, monkeypatch, arms):
    """Of two arms, that of the reference counts."""
    if arms == 2:
        read = train_command.frames_of_files
        monkeypatch.setattr(train_command, "frames_of_files", lambda *given: map(beside_another_arm, read(*given)))
    done = train(folder, *recorded(folder)[:-2])
    assert isinstance(done.exception, ModelError)
    assert "no cycle with a fault of joint 6: give --fault 6=RECORDING" in str(done.exception)
    assert "\n" not in str(done.exception)


def test_speeds_that_look_alike_have_files_of_their_own(folder, monkeypatch):
    (course,) = courses_of(load(folder / "reference.yaml"))
    several = [replace(course, speed=speed) for speed in (1.0, 0.304, 0.301)]
    monkeypatch.setattr(train_command, "courses_of", lambda _: several)
    told = [({"task": each.task, "speed": each.speed}, b"") for each in several]
    monkeypatch.setattr(train_command, "spread", lambda *_, **__: told)
    networks = json.loads(train(folder, "--json").stdout)["networks"]
    names = [f"task_1-{speed}-codes.onnx" for speed in ("1", "0.304", "0.301")]
    assert [Path(network["file"]).name for network in networks] == names


def test_the_network_of_the_example_names_the_elbow():
    arm = ArmSignals(seed=99)
    arm.disturb({"spring": 3.0, "stiffness": 80.0, "rest": arm.home[2]})
    frames = arm_frames(arm, 3 * arm.period, lead=1.0)
    alarms = watch(DEMO, frames, PaperFaultsStage, network=DEMO.parent / "fault-networks", power="supply.power")
    assert {alarm.joint for alarm in alarms if alarm.active} == {3}


def test_a_column_is_what_most_cycles_say():
    cycles = [np.array(codes, np.int8) for codes in ([1, 0, -1, 1], [1, -1, -1, 0], [1, 1, 0, -1])]
    assert column_of(cycles).tolist() == [1, 0, -1, 0]
