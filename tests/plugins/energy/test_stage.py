"""The live stage on production of the arm whose campaign the tests ran; true groups are the plant's."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from energy.live import BEGIN, RATE, frames_of, run_stages
from energy.plant import production

from cellwatt.errors import ConfigError, ModelError
from cellwatt.frames import Layout
from cellwatt.registry import stage as find_stage
from cellwatt.results import Alarm, Prediction, Task
from cellwatt.stage import CellInfo
from cellwatt_plugins.energy.stage import EnergySettings, EnergyStage

GROUPS = {
    "mechanical_losses": "mechanical",
    "electrical_losses": "electrical",
    "regeneration": "chopper",
    "positive_mechanical": "positive",
}


@pytest.fixture(scope="module")
def folder(measured, outcome):
    path = measured[1] / "out"
    path.mkdir(exist_ok=True)
    (path / "energy.json").write_text(json.dumps(outcome.findings.as_json()))
    return measured[1]


@pytest.fixture(scope="module")
def produced(measured):
    case, _, key = measured
    return production(case, key["fixed"], 500.0, 5.0, 6, 2.0, RATE)


@pytest.fixture(scope="module")
def results(folder, produced):
    seen, power, _ = produced
    return run_stages(frames_of(seen, power), folder, parts=2.0)


def of(results, kind):
    return [result for result in results if isinstance(result, kind)]


def test_it_is_found_by_name():
    assert find_stage("energy") is EnergyStage
    assert EnergyStage.needs == ("segment",)


def test_every_task_is_split(results, produced):
    tasks, told = of(results, Task), of(results, Prediction)
    assert len(told) == len(tasks) >= 5
    for task, prediction in zip(tasks, told, strict=True):
        first, last = (round((t - BEGIN) * RATE * 1e-9) for t in (task.start, task.end))
        total = produced[1][first:last].sum() / RATE
        assert prediction.time == (task.end,)
        assert prediction.model == f"energy_{task.name}"
        assert prediction.outputs["total"][0] == pytest.approx(total)
        assert prediction.outputs["total_per_part"][0] == pytest.approx(total / 2)
        for group, name in GROUPS.items():
            true = produced[2][name][first:last].sum() / RATE
            assert prediction.outputs[group][0] == pytest.approx(true, abs=0.01 * total)


def test_groups_add_up_to_what_was_measured(results):
    names = ("electronics", "brakes", "stored", "mechanical_losses", "electrical_losses", "regeneration", "unexplained")
    for prediction in of(results, Prediction):
        outputs = {name: values[0] for name, values in prediction.outputs.items()}
        assert sum(outputs[name] for name in names) == pytest.approx(outputs["total"], rel=1e-9)
        assert abs(outputs["unexplained"]) < 3 * outputs["uncertainty"] + 0.002 * outputs["total"]
    assert not [alarm for alarm in of(results, Alarm) if alarm.kind == "energy_balance"]


def test_sequence_is_that_of_the_tasks_last_frame(results):
    for prediction in of(results, Prediction):
        assert prediction.sequence == pytest.approx((prediction.time[0] - BEGIN) * RATE * 1e-9, abs=2)


def test_advice_is_given_once_with_its_saving(results):
    advice = [alarm for alarm in of(results, Alarm) if alarm.kind.startswith("energy_advice")]
    kinds = [alarm.kind for alarm in advice]
    assert len(set(kinds)) == len(kinds) > 0
    for alarm in advice:
        assert alarm.severity == "info"
        assert alarm.evidence["saving_J"] > 2 * alarm.evidence["uncertainty_J"]


def test_electronics_that_drift_are_followed(folder, produced):
    """A fan takes 4 W more: rests show it, and the split of later tasks counts it to the electronics."""
    seen, power, _ = produced
    told = of(run_stages(frames_of(seen, power + 4.0), folder), Prediction)
    before = of(run_stages(frames_of(seen, power), folder), Prediction)
    seconds = before[-1].outputs["electronics"][0] / before[-1].outputs["total"][0]
    assert seconds > 0
    more = [a.outputs["electronics"][0] - b.outputs["electronics"][0] for a, b in zip(told, before, strict=True)]
    assert more[-1] > more[0] > 0
    left = [prediction.outputs["unexplained"][0] for prediction in told]
    assert abs(left[-1]) < abs(left[0])


def test_a_consumer_that_is_in_no_group_is_told_and_cleared(folder, produced):
    """A gripper draws 40 W while the arm moves, in the first three tasks only."""
    seen, power, _ = produced
    moving = np.abs(seen["velocity"]).max(axis=1) > 0.02
    early = np.arange(len(power)) < 0.6 * len(power)
    results = run_stages(frames_of(seen, power + 40.0 * (moving & early)), folder)
    alarms = [alarm for alarm in of(results, Alarm) if alarm.kind == "energy_balance"]
    assert [alarm.active for alarm in alarms] == [True, False]
    assert alarms[0].evidence["unexplained_J"] > 0.1 * alarms[0].evidence["total_J"]
    assert alarms[0].id == alarms[1].id


def test_a_task_whose_power_is_missing_is_not_split(folder, produced):
    seen, power, _ = produced
    broken = power.copy()
    broken[len(power) // 2 :] = np.nan
    results = run_stages(frames_of(seen, broken), folder)
    whole = [task for task in of(results, Task) if task.end < BEGIN + len(power) // 2 * 1e9 / RATE]
    assert len(of(results, Prediction)) == len(whole) < len(of(results, Task))


def made(folder, layout, robot=None, **settings):
    given = {"robot": Path("robot.yaml"), "balance": Path("out/energy.json")} | settings
    return EnergyStage("energy", EnergySettings(**given), layout, CellInfo("a", "b", robot, folder))


def test_what_does_not_fit_is_refused(folder, produced, tmp_path):
    layout = frames_of(produced[0], produced[1]).layout
    with pytest.raises(ModelError, match="is of robot small, the cell's robot is ur10e"):
        made(folder, layout, robot="ur10e")
    with pytest.raises(ModelError, match=r"is not energy\.json"):
        made(folder, layout, balance=Path("key.json"))
    with pytest.raises(ModelError, match="cannot be read"):
        made(folder, layout, balance=Path("nowhere.json"))
    watts = replace(layout.channels[-1], unit="kW")
    with pytest.raises(ConfigError, match="is in kW, expected W"):
        made(folder, Layout((*layout.channels[:-1], watts), RATE))
    fewer = tuple(c for c in layout.channels if "joint_6" not in c.name)
    with pytest.raises(ConfigError, match="5 channels"):
        made(folder, Layout(fewer, RATE))
