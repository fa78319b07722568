"""Recordings as people have them: slow logs, joints at rest whose encoders jitter, arms that turn without end."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt.errors import RecordingError
from cellwatt_plugins.explain.input import reading
from cellwatt_plugins.robot import Arm
from tests.plugins.explain import recorded_arm
from tests.plugins.explain.input.reading import examine, read_runs
from tests.plugins.explain.logs import logged, measured, parquet, paused
from tests.plugins.explain.recorded_arm import JOINTS, excitation, without_plan
from tests.plugins.robot import scara


def recorded(path, moves):
    """A recording without a plan, and without power."""
    return replace(without_plan(recorded_arm.recorded(path, moves, "run")), power=None)


def slowly(described, rate, seconds, seed=1):
    """A recording at ``rate`` Hz whose logger is up to a twentieth of a step late."""
    run = recorded(described, excitation(seed, seconds=seconds, rate=rate))
    late = np.random.default_rng(seed).uniform(0, 0.05, len(run.time)) / rate
    return replace(run, time=run.time + late)


def admitted(*paths, arm):
    """What is said of recordings that are admitted."""
    return examine(read_runs(paths, [], arm.description), arm)[1]


@pytest.mark.parametrize("rate", [1.0, 10.0])
def test_a_slow_log_is_taken_as_it_is(rate, tmp_path, described, arm):
    path = logged(tmp_path, slowly(described, rate, seconds=max(40.0, 80 / rate)))
    run = read_runs([path], [], arm.description)[0]
    assert 1 / run.step == pytest.approx(rate, rel=0.05)
    notes = "\n".join(examine([run], arm)[1])
    assert f"recorded at {1 / run.step:.2g} Hz" in notes
    assert "elasticity, backlash, delays, contacts" in notes


def test_a_long_recording_was_not_recorded_as_slowly_as_it_is_examined(tmp_path, described, arm, monkeypatch):
    monkeypatch.setattr(reading, "SAMPLES", 20 * 20)
    notes = "\n".join(admitted(logged(tmp_path, recorded(described, excitation(1))), arm=arm))
    assert "averaged, as the recordings are long, to 20 Hz, which" in notes
    assert "recorded at" not in notes


def test_a_pause_does_not_make_a_recording_long(tmp_path, described, arm, monkeypatch):
    path = parquet(tmp_path / "log.parquet", paused(measured(recorded(described, excitation(1))), 60))
    monkeypatch.setattr(reading, "SAMPLES", 80 * 100)
    (whole,) = read_runs([path], [], arm.description)
    assert (whole.name, len(whole.time)) == ("log", 8000)
    monkeypatch.setattr(reading, "SAMPLES", 20 * 100)
    first, second = read_runs([path], [], arm.description)
    assert [run.name for run in (first, second)] == ["log (part 1)", "log (part 2)"]
    assert [run.step for run in (first, second)] == pytest.approx([0.01, 0.01])
    assert [len(run.time) for run in (first, second)] == [1000, 1000]
    assert not np.any([run.filled for run in (first, second)])
    assert [second.time[0], second.time[-1]] == pytest.approx([70.0, 79.99])
    (note,) = [note for note in examine([first, second], arm)[1] if "pause" in note]
    assert note == "log.parquet: its pauses are left out, and its 2 parts are used"


def test_rows_that_a_busy_logger_stamped_late_get_their_own_times(tmp_path, described, arm):
    run = recorded(described, excitation(1))
    late = np.random.default_rng(1).uniform(0, 0.4 * run.step, len(run.time))
    read = read_runs([logged(tmp_path, replace(run, time=run.time + late))], [], arm.description)[0]
    (note,) = [note for note in examine([read], arm)[1] if "stamps" in note]
    assert "rows were sampled up to 2.0 ms from their stamps, as the positions show" in note
    np.testing.assert_array_equal(read.position, run.position)


def test_rows_that_a_fast_logger_repeated_are_left_out(tmp_path, described, arm):
    run = recorded(described, excitation(1))
    rows = np.repeat(np.arange(len(run.time)), 2)
    twice = {name: getattr(run, name)[rows] for name in ("position", "velocity", "torque")}
    half = run.time[0] + 0.5 * run.step * np.arange(len(rows))
    read = read_runs([logged(tmp_path, replace(run, time=half, **twice))], [], arm.description)[0]
    (note,) = [note for note in examine([read], arm)[1] if "repeat" in note]
    assert f"{len(run.time)} of {len(rows)} rows left out" in note
    np.testing.assert_array_equal(read.position, run.position)


def jittering(size, share=0.05):
    """A joint at rest at 0.4 rad whose encoder now and then shows one step more."""
    random = np.random.default_rng(5)
    return 0.4 + 1e-7 * random.standard_normal(2000) + size * (random.random(2000) < share)


def test_an_encoder_that_jitters_at_rest_is_no_damage(tmp_path, described, arm):
    run = recorded(described, excitation(1))
    notes = "\n".join(admitted(logged(tmp_path, run, q_6=jittering(2e-4), qd_6=np.zeros(2000)), arm=arm))
    assert "unusable" not in notes
    assert "joint 6 never moved" in notes


def endless(described, folder, kind, limit):
    """The arm with joints 1, 4 and 6 of another ``kind``, with another ``limit``."""
    text = (described.parent / "bench.urdf").read_text().splitlines()
    old = '<limit lower="-3.5" upper="3.5" effort="300" velocity="6"/>'
    for i in (1, 4, 6):
        row = next(k for k, line in enumerate(text) if f'"axis_{i}"' in line)
        text[row] = text[row].replace('type="revolute"', f'type="{kind}"').replace(old, limit)
    (folder / "bench.urdf").write_text("\n".join(text))
    (folder / "robot.yaml").write_text(described.read_text())
    return folder / "robot.yaml"


@pytest.mark.parametrize(
    ("kind", "limit"),
    [("continuous", ""), ("revolute", '<limit effort="39" velocity="1.4"/>')],
)
def test_joints_that_turn_without_end_are_described_as_any_other(kind, limit, tmp_path, described, arm):
    endlessly = Arm.load(endless(described, tmp_path, kind, limit))
    moves = excitation(2, seconds=2.0)
    torque = endlessly.body.inverse_dynamics(moves.q, moves.qd, moves.qdd)
    np.testing.assert_allclose(torque, arm.body.inverse_dynamics(moves.q, moves.qd, moves.qdd), atol=1e-9)
    assert admitted(logged(tmp_path, recorded(described, excitation(1))), arm=endlessly)
    assert endlessly.body.limits[0, 1] == pytest.approx(2 * np.pi)
    assert endlessly.body.limits[1, 1] == 3.5


def test_columns_of_a_linear_axis_have_its_units(tmp_path):
    time, q, qd, qdd = scara.motion()
    arm = Arm.load(scara.write(tmp_path))
    torque = scara.torque(q, qd, qdd)
    columns = {"t": time, "q_1 [deg]": np.degrees(q[:, 0]), "q_2": q[:, 1], "q_3 [mm]": 1e3 * q[:, 2]}
    columns |= {"tau_1": torque[:, 0], "tau_2": torque[:, 1], "tau_3 [N]": torque[:, 2]}
    pq.write_table(pa.table(columns), tmp_path / "log.parquet")
    (run,) = read_runs([tmp_path / "log.parquet"], [], arm.description)
    np.testing.assert_allclose(run.position, q)
    assert examine([run], arm)[1] == ["no power recorded: effects that show only in the supply cannot be tested"]
    columns["tau_2 [N]"] = columns.pop("tau_2")
    pq.write_table(pa.table(columns), tmp_path / "log.parquet")
    with pytest.raises(
        RecordingError, match=r"unit of column tau_2 \[N\] is not one of joint axis_2, which is revolute"
    ):
        read_runs([tmp_path / "log.parquet"], [], arm.description)


def test_angles_modulo_a_turn_are_counted_on(tmp_path, described, arm):
    """One joint turns on and on, one swings across where the count begins anew; velocities are what they were."""
    moves = excitation(seed=2)
    low, screw = -np.pi, np.array([0, 0, 0, 0, 0, 0.7])
    moves = replace(moves, q=moves.q + low * np.eye(JOINTS)[1] + np.outer(moves.time, screw), qd=moves.qd + screw)
    run = recorded(described, moves)
    turned = low + np.mod(run.position - low, 2 * np.pi)
    assert np.abs(np.diff(turned[:, [1, 5]], axis=0)).max(axis=0).min() > 6
    path = logged(tmp_path, run, **{f"q_{j + 1}": turned[:, j] for j in (1, 5)})
    (found,) = read_runs([path], [], arm.description)
    turns = (found.position - run.position) / (2 * np.pi)
    np.testing.assert_allclose(turns, np.tile(np.round(turns[0]), (len(turns), 1)), atol=1e-9)
    (note,) = [note for note in examine([found], arm)[1] if "modulo a turn" in note]
    assert "q_2 (" in note
    assert "q_6 (" in note
