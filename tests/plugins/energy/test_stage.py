"""The live stage on production of the arm whose campaign the tests ran; true groups are the plant's."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from energy import live
from energy.live import BEGIN, RATE, frames_of, run_stages
from energy.plant import production

from cellwatt.errors import ConfigError, ModelError
from cellwatt.frames import Layout, cut
from cellwatt.record import Recording
from cellwatt.results import Alarm, Energy, Interval, Task
from cellwatt.stage import CellInfo
from cellwatt_plugins.energy.electronics import FOLLOW
from cellwatt_plugins.energy.stage import EnergySettings, EnergyStage
from cellwatt_plugins.robot import Arm
from tests.daemon.record.making import write_chunks

GROUPS = {"mechanical_losses": "mechanical", "electrical_losses": "electrical", "regeneration": "chopper"}


@pytest.fixture(scope="module")
def folder(measured, arm_and_known):
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


def test_every_task_is_split(results, produced):
    tasks, told = of(results, Task), of(results, Energy)
    assert len(told) == len(tasks) >= 5
    for task, energy in zip(tasks, told, strict=True):
        for name in ("source", "variant", "repetition", "start", "end"):
            assert getattr(energy, name) == getattr(task, name)
        assert energy.task == task.name
        part = slice(*(round((t - BEGIN) * RATE * 1e-9) for t in (task.start, task.end)))
        total = produced[1][part].sum() / RATE
        assert energy.total == pytest.approx(total)
        assert energy.total_per_part == pytest.approx(total / 2)
        for group, name in GROUPS.items():
            true = produced[2][name][part].sum() / RATE
            assert energy.groups[group] == pytest.approx(true, abs=0.01 * total)
        positive = produced[2]["positive"][part].sum() / RATE
        assert energy.positive_mechanical == pytest.approx(positive, abs=0.01 * total)
        assert energy.motion_efficiency_percent == pytest.approx(100 * positive / total, abs=1.0)


def test_a_replay_gives_the_same_to_the_bit_however_frames_are_cut(results, folder, produced, tmp_path, monkeypatch):
    write_chunks(tmp_path, [[frames_of(produced[0], produced[1]), *results]])
    recording = Recording.open(tmp_path)
    told = of(results, Energy)
    assert of(recording.results(), Energy) == told
    for block in (7, 400):
        monkeypatch.setattr(live, "BLOCK", block)
        again = run_stages(recording.frames_table(), folder, parts=2.0)
        assert [repr(energy) for energy in of(again, Energy)] == [repr(energy) for energy in told]


def test_advice_is_given_once_with_its_saving(results):
    advice = advised(results)
    kinds = [alarm.kind for alarm in advice]
    assert len(set(kinds)) == len(kinds) > 0
    for alarm in advice:
        assert alarm.severity == "info"
        assert alarm.evidence["saving_J"] > 2 * alarm.evidence["uncertainty_J"]


def test_electronics_that_drift_are_followed(folder, produced, results):
    """A fan takes 4 W more: rests show it, and the split of later tasks counts it to the electronics."""
    seen, power, _ = produced
    told = of(run_stages(frames_of(seen, power + 4.0), folder), Energy)
    both = zip(told, of(results, Energy), strict=True)
    more = [drifted.groups["electronics"] - before.groups["electronics"] for drifted, before in both]
    assert more[-1] > more[0] > 0
    assert abs(told[-1].groups["unexplained"]) < abs(told[0].groups["unexplained"])
    assert told[-1].total_per_part is None  # nobody said how many parts


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


@pytest.mark.parametrize(
    ("value", "reason"),
    [(np.nan, r"100.0 % of its frames are missing, most of meter.supply.power; up to 2 %"), (0.0, "shows no power")],
)
def test_a_task_whose_power_is_missing_is_not_split_which_is_reported(folder, produced, results, value, reason):
    """The meter is off in the second and third of the tasks."""
    seen, power, _ = produced
    tasks = of(results, Task)
    broken = power.copy()
    broken[slice(*(round((t - BEGIN) * RATE * 1e-9) for t in (tasks[0].end, tasks[3].start)))] = value
    results = run_stages(frames_of(seen, broken), folder)
    assert [energy.repetition for energy in of(results, Energy)] == [1, *range(4, len(tasks) + 1)]
    first, second, over = [alarm for alarm in of(results, Alarm) if alarm.kind == "energy_not_split"]
    assert re.search(f"energy of task_1 is not split: .*{reason}", first.statement)
    assert [(alarm.active, alarm.evidence) for alarm in (first, second, over)] == [
        (True, {"repetition": 2, "not_split": 1}),
        (True, {"repetition": 3, "not_split": 2}),
        (False, {"repetition": 4, "not_split": 2}),
    ]
    assert first.id == second.id == over.id
    assert advised(results)  # of the third repetition, which was not split, there was none


def advised(results):
    return [alarm for alarm in of(results, Alarm) if alarm.kind.startswith("energy_advice")]


@pytest.fixture
def fed(folder, produced):
    """A stage that has all frames, with ``more`` W of power; it is then given results of segment."""

    def make(more=0.0, **settings):
        frames = frames_of(produced[0], produced[1] + more)
        stage = made(folder, frames.layout, **settings)
        stage.process(frames, ())
        return lambda upstream: stage.process(cut(frames, len(frames), len(frames)), upstream)

    return make


def test_a_task_that_began_before_the_frames_stored_is_not_split(fed, results):
    task = of(results, Task)[0]
    (alarm,) = fed()([replace(task, start=task.start - 11 * 60 * 10**9)])
    assert "it began more than 10 min before it was recognised" in alarm.statement


def test_alarms_of_a_task_that_no_longer_runs_are_withdrawn(fed, results):
    """A gripper draws power, and the cell then makes another part."""
    process, tasks = fed(more=40.0), of(results, Task)
    raised = of(process(tasks[:3]), Alarm)
    assert "energy_balance" in {alarm.kind for alarm in raised}
    others = [replace(tasks[0], name="task_2", repetition=i + 1) for i in range(100)]
    assert [alarm for alarm in of(process(others[:-1]), Alarm) if not alarm.active] == []
    over = of(process(others[-1:]), Alarm)
    assert {alarm.id for alarm in over} == {alarm.id for alarm in raised}
    assert {alarm.statement for alarm in over} == {"Withdrawn: task_1 was none of the last 100 tasks"}
    again = [replace(task, repetition=task.repetition + 3) for task in tasks[:3]]
    assert {alarm.id for alarm in of(process(again), Alarm)} == {alarm.id for alarm in raised}


def waited(process, upstream):
    """Times for which advice on brakes takes the arm to wait, s."""
    brakes = [alarm for alarm in advised(process(upstream)) if alarm.kind == "energy_advice_brakes"]
    return {re.search(r"with (\d+) s of waiting", alarm.statement)[1] for alarm in brakes}


def another_name(result):
    """Every other repetition is of another task."""
    number, odd = (result.repetition + 1) // 2, result.repetition % 2
    return replace(result, name=f"task_{2 - odd}", repetition=number)


@pytest.mark.parametrize("what", ["another task in between", "a pause of production after the second repetition"])
def test_what_is_no_waiting_of_the_arm_after_its_task(fed, results, what):
    upstream = of(results, Interval | Task)
    if "task" in what:
        changed = [another_name(result) if isinstance(result, Task) else result for result in upstream]
        assert [task.repetition for task in of(changed, Task) if task.name == "task_1"][:3] == [1, 2, 3]
    else:
        after = of(upstream, Task)[1].intervals[-1] + 1
        rest = next(each for each in of(upstream, Interval) if each.closed and each.number == after)
        changed = [replace(each, end=each.end + 3600 * 10**9) if each is rest else each for each in upstream]
    assert waited(fed(brake_time=0.5), changed) == waited(fed(brake_time=0.5), upstream) == {"2"}


@pytest.mark.parametrize(("braked", "advised"), [(True, set()), (False, {"2"})])
def test_the_arm_at_rest_is_seen_in_a_rest_whose_frames_are_stored(outcome, fed, produced, results, braked, advised):
    """After three repetitions of more than 4 minutes, the frames of the first rest are gone."""
    upstream = of(results, Interval | Task)
    after = of(upstream, Task)[0].intervals[-1] + 1
    rest = next(each for each in of(upstream, Interval) if each.closed and each.number == after)
    gone = replace(rest, start=rest.start - 11 * 60 * 10**9, end=rest.end - 11 * 60 * 10**9 - 10**8)  # the shortest
    changed = [gone if each is rest else each for each in upstream]
    waits = braked & (np.abs(produced[0]["velocity"]).max(axis=1) < 0.02)
    less = np.where(waits, outcome.findings.fixed.electronics - produced[1], 0.0)
    assert waited(fed(more=less, brake_time=0.5), changed) == advised


@pytest.mark.parametrize("braked", [True, False])
def test_the_arm_at_rest_is_seen_at_the_end_of_rests_longer_than_the_frames_stored(
    outcome, folder, produced, results, monkeypatch, braked
):
    """When advice is due, the frames of a task and of the last second of the rest before it are stored."""
    second, third = of(results, Task)[1:3]
    assert second.end + 1.5e9 < third.start
    monkeypatch.setattr("cellwatt_plugins.energy.stage.LONGEST", third.end - third.start + 1_100_000_000)
    waits = braked & (np.abs(produced[0]["velocity"]).max(axis=1) < 0.02)
    less = np.where(waits, outcome.findings.fixed.electronics - produced[1], 0.0)
    told = run_stages(frames_of(produced[0], produced[1] + less), folder, brake_time=0.5)
    assert len(of(told, Energy)) >= 5
    assert ("energy_advice_brakes" in {alarm.kind for alarm in advised(told)}) is not braked


def test_electronics_are_followed_at_the_end_of_a_rest_longer_than_the_frames_stored(folder, produced, results):
    """A fan takes 4 W more from the lunch break on."""
    seen, power, _ = produced
    rest, minutes = slice(0, 100), 11
    still = {name: np.vstack([*[values[rest]] * 30 * minutes, values]) for name, values in seen.items()}
    watts = np.concatenate([*[power[rest]] * 30 * minutes, power])
    before, after = (
        [energy.groups["electronics"] for energy in of(run_stages(frames_of(still, watts + more), folder), Energy)]
        for more in (0.0, 4.0)
    )
    task = of(results, Task)[0]
    followed = 1 - (1 - FOLLOW) ** 2  # of this rest, and the one before the task is recognised
    assert after[0] - before[0] == pytest.approx(followed * 4.0 * (task.end - task.start) * 1e-9)


def test_a_slow_meters_window_is_in_the_uncertainty(folder, produced):
    """Means over 1 s, held, half a second late."""
    seen, power, _ = produced
    slow = np.repeat(power.reshape(-1, 50).mean(axis=1), 50)
    frames = frames_of(seen, np.concatenate([slow[:25], slow[:-25]]))
    *joints, meter = frames.layout.channels
    frames = replace(frames, layout=Layout((*joints, replace(meter, window=1.0)), RATE))
    for energy in of(run_stages(frames, folder), Energy):
        assert abs(energy.groups["unexplained"]) < 2.5 * energy.uncertainty


def test_without_torques_currents_times_the_constant_are_taken(results, folder, produced):
    """As in a campaign of an arm that gives currents only."""
    seen, power, _ = produced
    constant = Arm.load(folder).column("torque_constant")
    by_torque = frames_of(seen, power)
    named = [(c, c.name.replace("torque", "current"), c.unit.replace("Nm", "A")) for c in by_torque.layout.channels]
    channels = tuple(replace(c, name=name, unit=unit) for c, name, unit in named)
    values = by_torque.values.copy()
    values[:, 2 * len(constant) : 3 * len(constant)] /= constant
    frames = replace(by_torque, layout=Layout(channels, RATE), values=values)
    told = of(run_stages(frames, folder, parts=2.0), Energy)
    for ours, theirs in zip(told, of(results, Energy), strict=True):
        assert ours.groups == pytest.approx(theirs.groups)


@pytest.fixture
def late_meter(folder, tmp_path):
    """The folder of a campaign in whose every run the analyzer's values came 0.1 s late."""
    shutil.copytree(folder, tmp_path / "late", ignore=shutil.ignore_patterns("runs"))
    path = tmp_path / "late" / "out" / "energy.json"
    found = json.loads(path.read_text())
    for run in found["runs"]:
        run["analyzer_offset_s"] = 0.1
    path.write_text(json.dumps(found))
    return tmp_path / "late"


def test_power_that_comes_late_is_laid_over_the_motion_that_drew_it(results, late_meter, produced, monkeypatch):
    seen, power, _ = produced
    later = np.concatenate([np.full(5, power[0]), power[:-5]])
    told = of(run_stages(frames_of(seen, later), late_meter, parts=2.0), Energy)
    assert len(told) == len(of(results, Energy))
    for ours, theirs in zip(told[:-1], of(results, Energy)[:-1], strict=True):  # the last one's power has not all come
        assert (ours.start, ours.end) == (theirs.start, theirs.end)
        assert ours.total == pytest.approx(theirs.total, rel=1e-9)
    monkeypatch.setattr(live, "BLOCK", 7)
    again = of(run_stages(frames_of(seen, later), late_meter, parts=2.0), Energy)
    assert [repr(energy) for energy in again] == [repr(energy) for energy in told]


def made(folder, layout, robot=None, **settings):
    given = {"robot": Path("robot.yaml"), "balance": Path("out/energy.json")} | settings
    return EnergyStage("energy", EnergySettings(**given), layout, CellInfo("a", "b", robot, folder))


def test_what_does_not_fit_is_refused(folder, produced, tmp_path):
    layout = frames_of(produced[0], produced[1]).layout
    with pytest.raises(ModelError, match="is of robot small, the cell's robot is ur10e"):
        made(folder, layout, robot="ur10e")
    assert made(folder, layout, robot="robot.yaml")
    with pytest.raises(ModelError, match="cannot be read"):
        made(folder, layout, balance=Path("nowhere.json"))
    watts = replace(layout.channels[-1], unit="kW")
    with pytest.raises(ConfigError, match="is in kW, expected W"):
        made(folder, Layout((*layout.channels[:-1], watts), RATE))
    fewer = tuple(c for c in layout.channels if "joint_6" not in c.name)
    with pytest.raises(ConfigError, match="5 channels"):
        made(folder, Layout(fewer, RATE))
