"""Whole campaigns of arms whose energies are known; the plant shares no code with the product."""

from dataclasses import replace

import numpy as np
import pytest
from energy.arms import make_arm

from cellwatt.errors import RecordingError
from cellwatt.tables import write_table
from cellwatt_plugins.energy.campaign import observed
from cellwatt_plugins.energy.identify import begin
from cellwatt_plugins.energy.recordings import PowerTrace, read_motion, read_reading, read_runs
from cellwatt_plugins.robot import Arm
from tests.plugins.energy.running import run_on, with_truth, worst_error


def test_every_group_is_within_a_percent(measured, outcome):
    assert worst_error(measured[2], outcome.findings) < 1.0


def test_torque_gains_of_the_joints_that_work(measured, outcome):
    true = make_arm(measured[0]).gains
    found = [joint.torque_gain for joint in outcome.findings.drives]
    assert np.array(found)[:3] == pytest.approx(true[:3], rel=0.02)
    assert any("corrected" in note for note in outcome.findings.notes)


def test_regeneration_is_told_from_electrical_losses(measured, outcome):
    for run, true in with_truth(measured[2], outcome.findings):
        assert run.regeneration == pytest.approx(true["regeneration"], abs=0.01 * true["total"])
        assert run.regeneration <= run.regeneration_upper_bound
    fastest = max(measured[2]["runs"], key=lambda run: run["regeneration"])
    assert fastest["regeneration"] > 0.02 * fastest["total"]  # there was something to find
    assert outcome.findings.returned == pytest.approx(0.5, abs=0.05)


def test_groups_add_up(outcome):
    for run in outcome.findings.runs:
        assert sum(run.split) == pytest.approx(run.total, rel=1e-9)


def test_errors_are_within_the_stated_uncertainty(measured, outcome):
    pulls = [
        abs(getattr(run, group) - true[group]) / max(run.uncertainty[group], 1e-4 * true["total"])
        for run, true in with_truth(measured[2], outcome.findings)
        for group in ("total", "mechanical_losses", "electrical_losses_with_regeneration", "positive_mechanical")
    ]
    assert np.mean(np.array(pulls) < 2) > 0.85


def test_an_edge_that_is_off_counts_with_all_that_is_drawn_there(outcome):
    """Electronics, brakes and what holds the arm and its payload: the total cannot be more certain than that."""
    level = outcome.findings.fixed.electronics + outcome.findings.fixed.brakes
    at_edges = {run.run: run.uncertainty["total"] / run.uncertainty["seconds"] for run in outcome.findings.runs}
    for speed in (150, 400, 1400):
        assert at_edges[f"{speed}_5kg"] > at_edges[f"{speed}_0kg"] > level


def test_torque_so_far_off_that_losses_would_be_negative(variant):
    folder, key = variant(gear=0.005, speeds=(150.0, 900.0), gains=(0.75, 1.25), seed=28)
    findings = run_on(folder).findings
    assert all(run.mechanical_losses >= 0 for run in findings.runs)
    assert any("would be negative" in note for note in findings.notes)
    assert worst_error(key, findings) < 1.0


def test_an_arm_without_brakes_that_cannot_be_unplugged(variant):
    built = {"joints": 7, "current": False, "gear": 0.3, "brakes": 0.0, "separate": False}
    folder, key = variant(**built, speeds=(200.0, 900.0), seed=24, payload=3.0)
    findings = run_on(folder).findings
    assert findings.fixed.brakes == 0
    assert all(run.brakes == 0 for run in findings.runs)
    assert any("cannot be unplugged" in note for note in findings.fixed.notes)
    assert worst_error(key, findings) < 1.0


def test_a_blank_in_a_row_is_a_row_that_is_missing(tmp_path):
    time = np.arange(200) / 100
    blank = np.where(np.arange(200) == 50, np.nan, np.sin(time))
    write_table(tmp_path / "analyzer.csv", {"t": time, "power": blank})
    columns = {f"{name}_{joint}": np.sin(time + joint) for name in ("q", "qd", "tau") for joint in (1, 2)}
    write_table(tmp_path / "robot.csv", {"t": time, **columns, "tau_2": blank})
    reading, motion = read_reading(tmp_path / "analyzer.csv"), read_motion(tmp_path / "robot.csv", ("a", "b"))
    assert np.array_equal(reading.time, np.delete(time, 50))
    assert np.diff(motion.time) == pytest.approx(0.01)
    assert motion.torque[:, 1] == pytest.approx(np.sin(motion.time), abs=1e-3)
    write_table(tmp_path / "analyzer.csv", {"t": time[41:61], "power": blank[41:61]})
    with pytest.raises(RecordingError, match="19 rows without a missing value, expected 20 or more"):
        read_reading(tmp_path / "analyzer.csv")


def test_a_repetition_in_which_the_analyzer_fell_silent_is_left_out(measured):
    arm = Arm.load(measured[1])
    run = read_runs(measured[1] / "runs", arm.description.names)[0]
    whole = observed(run, (arm, begin(arm, 50.0)))
    (*_, last) = whole.repetitions
    early = run.reading.time - whole.offset.seconds < (last.start + last.end) / 2
    reading = PowerTrace("analyzer", run.reading.time[early], run.reading.power[early])
    cut = observed(replace(run, reading=reading), (arm, begin(arm, 50.0)))
    assert cut.repetitions == whole.repetitions[:-1]
    assert cut.notes == (f"the repetition at t = {last.start:.1f} s: too few values of the analyzer: not used",)
