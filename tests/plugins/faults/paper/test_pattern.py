"""The power equation in place of the mean pattern: made by `cellwatt train pattern`, used by `faults_by_paper`."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

from cellwatt.errors import ModelError
from cellwatt_plugins.faults.paper import equation
from cellwatt_plugins.faults.paper.bevf import rms
from cellwatt_plugins.faults.paper.pattern import cycle_pattern
from cellwatt_plugins.faults.paper.train_pattern import _fitted, _written
from cellwatt_plugins.faults.reference import load
from cellwatt_plugins.models.command import train
from tests.plugins.faults.paper.irb1200 import POLISHING, Fault, Run, period, run
from tests.plugins.faults.paper.test_stage import BELT, CREEP, CUT, plan, watch
from tests.plugins.faults.watching import called, learned


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Polishing, and its equations of 44 poles in the folder beside."""
    folder = tmp_path_factory.mktemp("pattern")
    path = learned(folder / "reference.yaml", plan(1.0, cycles=6, seed=1))
    (folder / "told.json").write_text(called(train, "pattern", path, "--out", folder / "equations", "--json").stdout)
    return path


def changed(reference, folder, change):
    """A copy of the equations in a folder, its file changed."""
    shutil.copytree(reference.parent / "equations", folder)
    (file,) = folder.glob("*.yaml")
    file.write_text(yaml.safe_dump(change(yaml.safe_load(file.read_text()))))
    return folder


def test_the_pattern_is_the_power_of_a_whole_cycle(reference):
    """Motions and rests between, against what the plant draws without noise."""
    t, power = cycle_pattern(load(reference).tasks[0].variants[0])
    true = run(Run(POLISHING, 2, rate=500.0, noise=0.0))
    length = period(POLISHING) - POLISHING[-1].rest
    assert t[-1] == pytest.approx(length, abs=0.1)
    lates = period(POLISHING) + np.linspace(-0.1, 0.1, 41)
    assert min(rms(np.interp(t + late, true.t, true.power), power) for late in lates) < 0.06 * np.std(power)


def test_the_command_writes_the_equation_and_its_fit(reference):
    (told,) = json.loads((reference.parent / "told.json").read_text())
    ours = [told["rms"].pop(f"BEVF {order}") for order in (24, 34, 44)]
    assert ours == sorted(ours, reverse=True)
    t, power = cycle_pattern(load(reference).tasks[0].variants[0])
    written = equation.load(Path(told["file"]))
    assert rms(written.power(t), power) == pytest.approx(ours[-1], rel=1e-3)
    assert (written.task, written.speed) == ("task_1", 1.0)


@pytest.mark.parametrize(
    ("faults", "expected"),
    [
        ((), set()),
        ((CUT, BELT, CREEP), {(2, "joint_and_encoder_fault"), (5, "joint_fault")}),
        ((Fault("friction", 5, 20.0),), {(5, "joint_fault")}),
    ],
)
def test_the_model_as_reference_names_the_same_faults(reference, faults, expected):
    alarms = watch(reference, plan(1.0, *faults), equations=Path("equations"))
    assert {(alarm.joint, alarm.kind) for alarm in alarms if alarm.active} == expected


def test_it_is_the_equation_that_power_is_compared_with(reference, tmp_path):
    """30 % more of it than was measured, and healthy cycles are faulty."""

    def more(told):
        return told | {"K": 1.3 * told["K"], "r": (1.3 * np.array(told["r"])).tolist()}

    assert watch(reference, plan(1.0), equations=changed(reference, tmp_path / "equations", more)) != []


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"task": "task_9"}, "none is of task_1 at speed 1.00; make them with `cellwatt train pattern`"),
        ({"duration": 3.0}, "is 3.00 s long, the task .* s: it is of another reference"),
        ({"task": None}, "names no task"),
    ],
)
def test_equations_of_something_else_are_refused(reference, tmp_path, change, problem):
    folder = changed(reference, tmp_path / "equations", lambda told: told | change)
    with pytest.raises(ModelError, match=problem):
        watch(reference, plan(1.0), equations=folder)


def test_a_tasks_name_names_no_place_outside_the_folder(reference, tmp_path):
    """A reference may come from anybody."""
    file = tmp_path / "______task_1-1.yaml"
    variant = load(reference).tasks[0].variants[0]
    assert _written(*_fitted(("../../task_1", variant), 24), tmp_path)["file"] == str(file)
    assert list(tmp_path.iterdir()) == [file]
