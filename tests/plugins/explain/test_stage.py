"""The live stage on frames of an arm at work."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from itertools import chain, islice

import numpy as np
import pytest

from cellwatt.errors import ConfigError
from cellwatt.frames import cut
from cellwatt.results import Alarm, Prediction
from cellwatt.stage import CellInfo
from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.explain.input.baseline import Baseline
from cellwatt_plugins.explain.input.moved import moved
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.live.settings import MismatchSettings
from cellwatt_plugins.explain.live.simulation import Simulation
from cellwatt_plugins.explain.model import FittedTerm, Model, Retuned, predict_states, save_model
from cellwatt_plugins.explain.stage import MismatchStage
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.effects import BY_NAME
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import QUICK_OCTAVES
from cellwatt_plugins.segment import SegmentSettings, SegmentStage
from tests.blocks import layout_of
from tests.plugins.explain.emulated_arm import LAYOUT, START, frames, recorded
from tests.plugins.explain.recorded_arm import COULOMB, write_robot


def made(folder, lay=None, cell_robot=None, **settings):
    cell = CellInfo("plant", "cell", cell_robot, folder)
    chosen = MismatchSettings(**({"robot": None if cell_robot else folder, "explain": None} | settings))
    return MismatchStage("mismatch", chosen, lay or LAYOUT, cell)


def fed(stage, whole, size=50):
    """What the stage gives for each block, with the segmenter before it."""
    segment = SegmentStage("segment", SegmentSettings(), whole.layout, stage.cell)
    for first in range(0, len(whole), size):
        block = cut(whole, first, first + size)
        yield stage.process(block, segment.process(block, ()))


def run(stage, whole, size=50):
    """What the stage gives, in order."""
    return [*chain.from_iterable(fed(stage, whole, size)), *stage.close()]


def alarms(results):
    return [r for r in results if isinstance(r, Alarm)]


def seconds(time):
    return (time - START) * 1e-9


@pytest.fixture(scope="module")
def healthy():
    return frames(recorded(24))


@pytest.fixture(scope="module")
def stiff():
    """Friction comes on joint 2 at 14 s and goes at 34 s."""
    return frames(recorded(60, viscous=30.0, since=14.0, until=34.0))


def test_a_healthy_arm_stays_in_its_bands(robot, healthy):
    stage = made(robot)
    assert alarms(run(stage, healthy)) == []
    assert stage.counts["intervals judged"] > 15


def test_friction_that_comes_and_goes_is_told_with_its_time(robot, stiff):
    found = [a for a in alarms(run(made(robot), stiff)) if a.joint is not None]
    assert [(a.joint, a.active) for a in found] == [(2, True), (2, False)]
    raised, cleared = found
    assert raised.kind == "simulation_differs"
    assert raised.id == cleared.id == "mismatch.arm.joint_2.torque.simulation_differs"
    assert 13.0 < seconds(raised.since) < 17.5, "since the first move of joint 2 with it"
    assert seconds(raised.time) < 14.0 + 7.5, "three moves of joint 2, within a cycle"
    assert raised.evidence["residual_Nm"] > raised.evidence["limit_Nm"] > raised.evidence["noise_floor_Nm"]
    assert raised.evidence["frames_missing"] == 0
    assert cleared.since == raised.since
    assert 34.0 < seconds(cleared.time) < 58.0


def test_results_do_not_depend_on_how_frames_are_cut(robot, stiff):
    whole = cut(stiff, 0, 1300)
    one, many = run(made(robot), whole, 1), run(made(robot), whole, 333)
    assert alarms(one) == alarms(many) != []
    assert predictions_of(one) == predictions_of(many)


def predictions_of(results):
    return [(r.sequence, r.time, r.outputs) for r in results if isinstance(r, Prediction)]


def test_frames_without_motion_or_torque_are_left_out_and_counted(robot, stiff):
    values = stiff.values.copy()
    values[300:302, 3] = np.nan  # bridged
    values[500:600, 3] = np.nan  # a hole
    values[700:710, 14] = np.nan  # torque alone
    whole = replace(stiff, values=values)
    stage = made(robot)
    results = run(stage, whole)
    raised = next(a for a in alarms(results) if a.joint == 2)
    assert raised.evidence["frames_missing"] == 112
    assert stage.counts["torque missing"] == 10
    predictions = [r for r in results if isinstance(r, Prediction)]
    said = {s: np.array(p.outputs["arm.joint_1.torque"]) for p in predictions for s in [p.sequence]}
    given = np.concatenate([s + np.arange(len(v)) for s, v in said.items()])
    nothing = np.concatenate([s + np.flatnonzero(np.isnan(v)) for s, v in said.items()])
    assert nothing.tolist() == [300, 301]
    assert not set(range(485, 615)) & set(given.tolist()), "no acceleration is known beside a hole"


def test_effects_that_need_the_whole_past_are_left_out_and_told_once(robot, tmp_path, healthy):
    cold = ("temperature_dependent_friction", 2, (600.0, 1.0), [8.0])
    path = modelled(robot, tmp_path, cold, ("torque_drift", 0, (0.0,), [30.0]), ("torque_offset", 4, (), [0.01]))
    found = alarms(run(made(robot, simulation=str(path)), healthy))
    assert [a.kind for a in found] == ["effect_not_followed"]
    assert found[0].evidence["effects"] == ["temperature dependent friction of joint 3", "torque drift of joint 1"]
    assert found[0].severity == "info"


def modelled(robot, folder, *terms):
    """A model.yaml with effects: name, 0-based joint, shape, coefficients."""
    fitted = tuple(FittedTerm(Term(BY_NAME[n], joint, shape), np.array(c)) for n, joint, shape, c in terms)
    arm = Arm.load(robot)
    save_model(Model(Baseline(arm, arm), Retuned.nothing(6), fitted), folder / "model.yaml")
    return folder / "model.yaml"


def test_an_arm_that_is_mounted_otherwise_than_its_simulation_is_followed_as_it_is_mounted(robot):
    arm = Arm.load(robot)
    wall = arm.with_gravity(np.array([9.81, 0.0, 0.0]))
    pose = np.tile(np.linspace(0.2, 0.7, 6), (100, 1))
    model = Model(Baseline(arm, wall), Retuned.nothing(6))
    simulation = Simulation(model, 0.02, False, None, None)
    said, _ = simulation.run(np.arange(100) / 50, pose, None, None, None)
    assert np.allclose(said.torque, wall.gravity(pose), atol=1e-6)
    assert simulation.known == {("gravity_tilt", None)}, "an explanation finds it again"


def test_the_cells_robot_is_the_default(robot):
    assert made(robot, cell_robot=".")
    with pytest.raises(ConfigError, match=r"set `robot` to a folder with robot\.yaml"):
        made(robot, robot=None)


def test_channels_must_be_there_in_their_units(robot):
    positions = {f"arm.joint_{i}.position": "rad" for i in range(1, 7)}
    with pytest.raises(ConfigError, match=r"gives no joint_1\.torque, joint_1\.current or joint_1\.target_position"):
        made(robot, layout_of(positions))
    with pytest.raises(ConfigError, match=r"arm\.joint_1\.torque is in N, expected Nm"):
        made(robot, layout_of(positions | {f"arm.joint_{i}.torque": "N" for i in range(1, 7)}))
    with pytest.raises(ConfigError, match="source arm has 3 joints, the robot's description 6"):
        made(robot, layout_of(dict(islice(positions.items(), 3))))
    torques = {f"arm.joint_{i}.torque": "Nm" for i in range(1, 7)}
    two = layout_of(positions | torques | {"board.supply.power": "W", "meter.supply.power": "W"})
    with pytest.raises(ConfigError, match=r"write one of board\.supply\.power, meter\.supply\.power"):
        made(robot, two)
    assert made(robot, two, power="meter.supply.power")


def test_without_its_packages_it_names_the_extra(tmp_path):
    write_robot(tmp_path)
    code = f"""
import json, sys
sys.modules["pinocchio"] = None
from cellwatt.errors import ConfigError
from cellwatt.frames import Layout
from cellwatt.stage import CellInfo
from pathlib import Path
from cellwatt_plugins.explain.stage import MismatchStage
from cellwatt_plugins.explain.live.settings import MismatchSettings
scipy = "scipy" in sys.modules
try:
    MismatchStage("live", MismatchSettings(), Layout((), 50.0), CellInfo("s", "c", None, Path({str(tmp_path)!r})))
except ConfigError as error:
    print(json.dumps([scipy, str(error)]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    loaded, said = json.loads(done.stdout)
    assert said == "stage 'live' needs the package pinocchio: pip install 'cellwatt[explain]'"
    assert not loaded, "its settings are read without scipy"


def test_live_is_what_offline_says_of_the_whole_recording(robot, healthy):
    """Window by window or all at once: the same formulas, up to what the encoders' noise is taken for near stops."""
    predictions = [r for r in run(made(robot), healthy) if isinstance(r, Prediction)]
    rows = np.concatenate([p.sequence + np.arange(len(p.time)) for p in predictions])
    live = np.column_stack([np.concatenate([p.outputs[n] for p in predictions]) for n in predictions[0].outputs])
    described = Arm.load(robot)
    time, values = np.arange(len(healthy)) / 50, healthy.values
    whole = Run("whole", time, values[:, :6], values[:, 6:12], values[:, 12:18])
    states = States("whole", -1, time, moved(whole, QUICK_OCTAVES), described)
    said = predict_states(Model(Baseline(described, described), Retuned.nothing(6)), states)
    error = np.abs(live[:, :6] - said.torque[rows])
    fast = np.abs(states.qd[rows]) > 0.05
    assert error[fast].max() < 1e-4
    assert np.all(np.sqrt(np.mean(error**2, axis=0)) < 0.02 * COULOMB)
