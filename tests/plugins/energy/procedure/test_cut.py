"""Runs cut from a recording: all of them, and why some are refused."""

import numpy as np
import pyarrow.parquet as pq
import pytest

from cellwatt.errors import RecordingError
from cellwatt_plugins.energy.procedure.cut import cut_programme, cut_state
from cellwatt_plugins.energy.procedure.recorded import motion_of, power_of
from cellwatt_plugins.energy.recordings import read_motion
from cellwatt_plugins.energy.repetitions import find_repetitions
from tests.plugins.energy.procedure.conftest import SPEEDS
from tests.plugins.energy.procedure.plant import BETWEEN, DWELL, STEP
from tests.plugins.energy.procedure.recording import Taped


def begins(plant, speed, repetition):
    """Sample at which a repetition (from 0) begins in the fixture's program."""
    at = BETWEEN
    for other in SPEEDS:
        loop = DWELL + sum(round(s / STEP) * STEP for s in plant.cube.seconds(other))
        if other == speed:
            return round((at + repetition * loop + DWELL) / STEP)
        at += 3 * loop + BETWEEN
    raise AssertionError(speed)


@pytest.fixture
def cut(plant, arm, tmp_path):
    """Tapes a program, cuts it, gives runs by name."""

    def run(rows, watts, silent=None, least=3, speeds=SPEEDS):
        taped = Taped(tmp_path, plant)
        taped.programme(0.0, rows, watts)
        if silent:
            taped.without(*silent)
        recording = taped.write().between(*taped.programmes[0.0])
        runs = cut_programme(arm, motion_of(recording, arm), power_of(recording), 0.0, speeds, 3, least, tmp_path)
        return {one.run: one for one in runs}

    return run


def test_all_repetitions_of_all_speeds(cut, programme, plant, arm, tmp_path):
    runs = cut(*programme)
    assert list(runs) == ["200_0kg", "250_0kg"]
    for speed in SPEEDS:
        found = runs[f"{speed:g}_0kg"]
        assert (found.repetitions, found.refused, found.written) == (3, (), True)
        motion = read_motion(tmp_path / "runs" / f"{found.run}.robot.parquet", arm.description.names)
        assert motion.step == pytest.approx(0.01)
        kept, notes = find_repetitions(motion)
        assert notes == []
        seconds = plant.truth(speed, 0.0)["seconds"]
        assert [r.seconds for r in kept] == pytest.approx([seconds] * 3, abs=0.05)


def test_what_the_files_hold_is_what_arm_and_analyzer_said(cut, programme, plant, tmp_path):
    """Torques are the recorded currents times the torque constants; power is the supply's, beside the motion."""
    rows, watts = programme
    cut(rows, watts)
    robot = pq.read_table(tmp_path / "runs" / "250_0kg.robot.parquet")
    given = np.stack([robot[f"{stem}_{i}"] for stem in ("q", "qd", "tau") for i in range(1, 7)], axis=1)
    at = int(np.argmin(np.abs(rows - given[0]).max(axis=1)))
    np.testing.assert_allclose(given, rows[at : at + 5 * len(given) : 5], atol=1e-9)
    assert at == pytest.approx(begins(plant, 250.0, 0) - 0.9 * DWELL / STEP, abs=0.1 / STEP)
    analyzer = pq.read_table(tmp_path / "runs" / "250_0kg.analyzer.parquet")
    time, power = (analyzer[name].to_numpy() for name in ("t", "power"))
    assert time[0] == pytest.approx(-1.0, abs=0.15)
    assert time[-1] == pytest.approx(float(robot["t"].to_numpy()[-1]) + 1.0, abs=0.15)
    start = at - round(1.0 / STEP)
    assert power.mean() == pytest.approx(watts[start : start + round(len(power) * 0.1 / STEP)].mean(), abs=0.3)


def test_an_interrupted_repetition_is_refused_with_the_reason(cut, programme, plant, tmp_path):
    """A protective stop of 4 s in the second of three: two are left, not in a row."""
    rows, watts = programme
    at = begins(plant, 250.0, 1) + round(2.6 / STEP)
    still = rows[at].copy()
    still[6:12] = 0
    held = np.repeat(still[None], round(4 / STEP), axis=0)
    stopped = np.vstack([rows[:at], held, rows[at:]])
    power = np.concatenate([watts[:at], np.full(len(held), watts[0]), watts[at:]])
    runs = cut(stopped, power, least=1)
    assert runs["200_0kg"].repetitions == 3
    assert runs["250_0kg"].repetitions == 1
    (sentence,) = runs["200_0kg"].refused + runs["250_0kg"].refused
    assert "interrupted" in sentence
    runs = cut(stopped, power, least=3)
    assert not runs["250_0kg"].written
    assert "1 of 3 repetitions, too few: not written, run it again" in runs["250_0kg"].in_words()


def test_a_recording_that_ends_on_the_way_is_incomplete(cut, programme, plant):
    rows, watts = programme
    end = begins(plant, 250.0, 2) + round(3 / STEP)
    runs = cut(rows[:end], watts[:end], least=2)
    assert runs["250_0kg"].repetitions == 2
    assert any("does not return to the start pose: incomplete" in s for run in runs.values() for s in run.refused)


def test_a_speed_that_was_not_asked_for(cut, programme):
    runs = cut(*programme, speeds=(100.0, 200.0), least=1)
    assert runs["200_0kg"].repetitions == 3
    assert (runs["100_0kg"].repetitions, runs["100_0kg"].written) == (0, False)
    assert sum("mm/s, none of 100, 200: interrupted?" in s for s in runs["100_0kg"].refused) == 3


@pytest.mark.parametrize(
    ("source", "said"), [("arm", "the arm's samples are missing for 1.0"), ("supply", "analyzer's")]
)
def test_missing_samples_spoil_their_repetition_alone(cut, programme, plant, source, said):
    at = begins(plant, 250.0, 2) * STEP + 3
    runs = cut(*programme, silent=(source, at, at + 1), least=2)
    assert runs["250_0kg"].repetitions == 2
    assert runs["200_0kg"].repetitions == 3
    assert any(said in sentence for sentence in runs["250_0kg"].refused)


def test_an_arm_that_never_moves(cut, programme):
    rows, watts = programme
    wrist = np.where(np.arange(18) % 6 == 5, np.roll(rows, 5, axis=1), rows[0])
    with pytest.raises(RecordingError, match="payload 0 kg: the flange does not move between rests at the start pose"):
        cut(wrist, watts)
    with pytest.raises(RecordingError, match="payload 0 kg: the arm does not return"):
        cut(rows[:1100], watts[:1100])
    with pytest.raises(RecordingError, match="10 samples of arm in it, expected 20"):
        cut(rows[:10], watts[:1000])


def test_a_reading_at_rest_is_cut_with_its_mean(plant, programme, tmp_path):
    taped = Taped(tmp_path, plant)
    taped.state("controller", 54.0)
    taped.state("connected", 81.4)
    taped.programme(0.0, programme[0][:2000], programme[1][:2000])
    recording = taped.write()
    for name, watt in (("controller", 54.0), ("connected", 81.4)):
        found = cut_state(power_of(recording.between(*taped.states[name])), tmp_path / f"{name}.parquet")
        assert found.steady and found.power == pytest.approx(watt, abs=0.02)
        table = pq.read_table(tmp_path / f"{name}.parquet")
        assert table["power"].to_numpy().mean() == pytest.approx(watt, abs=0.02)
        assert np.ptp(table["t"].to_numpy()) == pytest.approx(60, abs=0.2)


def test_a_repetition_that_turns_back_took_another_way(cut, programme, plant):
    rows, watts = programme
    start = begins(plant, 200.0, 1)
    half, whole = start + round(2 / STEP), start + round(plant.cube.seconds(200.0).sum() / STEP)
    back = rows[start:half][::-1].copy()
    back[:, 6:12] *= -1
    turned = np.vstack([rows[:half], back, rows[whole:]])
    power = np.concatenate([watts[:half], watts[start:half][::-1], watts[whole:]])
    runs = cut(turned, power, least=1)
    assert runs["200_0kg"].repetitions == 1
    assert any("another path" in sentence for sentence in runs["200_0kg"].refused)
