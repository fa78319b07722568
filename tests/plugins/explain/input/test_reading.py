import numpy as np
import pytest

from cellwatt.errors import ConfigError, RecordingError
from cellwatt.record import Header, Recorder, RecordSettings
from cellwatt_plugins.explain.input.reading import read_motion
from cellwatt_plugins.explain.input.signals import read_signals
from cellwatt_plugins.robot import Arm
from tests.plugins.explain.emulated_arm import LAYOUT, START, framed
from tests.plugins.explain.input.reading import read_runs
from tests.plugins.explain.logs import numbered, parquet
from tests.plugins.explain.recorded_arm import CONSTANT, JOINTS, write_robot

RATE = 125.0


def motion(t):
    """Position, velocity, acceleration and torque of every joint, in closed form."""
    w = 0.5 + 0.2 * np.arange(JOINTS)
    angle = np.outer(t, w)
    return np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle), 10 * np.cos(angle / 2)


def recording(t, **more):
    q, qd, _, tau = motion(t)
    return {"t": t, **numbered("q", q), **numbered("qd", qd), **numbered("tau", tau), "power": 100 + t, **more}


def simulation(t):
    q, qd, qdd, tau = motion(t)
    planned = {"t": t, **numbered("q", q), **numbered("qd", qd), **numbered("qdd", qdd)}
    return planned | numbered("tau", tau) | {"power": 90 + t}


def times(seconds=8.0, rate=RATE):
    return np.arange(round(seconds * rate)) / rate


def csv(path, columns, separator=","):
    rows = zip(*columns.values(), strict=True)
    lines = [separator.join(columns), *(separator.join(f"{cell:.10g}" for cell in row) for row in rows)]
    path.write_text("\n".join(lines) + "\n")
    return path


def one(path, arm):
    (run,) = read_runs([path], [], arm.description)
    return run


def refused(path, arm, simulations=()):
    with pytest.raises((RecordingError, ConfigError)) as caught:
        read_runs([path], simulations, arm.description)
    message = str(caught.value)
    assert "\n" not in message
    return message


def test_a_table_and_its_simulation_become_a_run(tmp_path, arm):
    t = times()
    seen = parquet(tmp_path / "run_01.recording.parquet", recording(t, **numbered("temperature", 30 + motion(t)[0])))
    said = parquet(tmp_path / "run_01.simulation.parquet", simulation(t))
    (run,) = read_runs([seen], [said], arm.description)
    q, qd, qdd, tau = motion(t)
    assert run.name == "run_01"
    assert run.step == pytest.approx(1 / RATE)
    for got, true in ((run.position, q), (run.velocity, qd), (run.torque, tau), (run.temperature, 30 + q)):
        np.testing.assert_array_equal(got, true)
    np.testing.assert_array_equal(run.power, 100 + t)
    assert not run.gaps.any()
    assert run.notes == ()
    for got, true in ((run.plan.position, q), (run.plan.velocity, qd), (run.plan.acceleration, qdd)):
        np.testing.assert_allclose(got, true, atol=1e-12)
    np.testing.assert_allclose(run.simulated.torque, tau)
    np.testing.assert_allclose(run.simulated.power, 90 + t)


def test_rtde_names_count_from_0_and_hold_the_plan(tmp_path, arm):
    t = times()
    q, qd, qdd, tau = motion(t)
    columns = {
        "timestamp": t + 4029.5,
        **numbered("target_q", q, 0),
        **numbered("target_qd", qd, 0),
        **numbered("target_qdd", qdd, 0),
        **numbered("actual_q", q + 1e-3, 0),
        **numbered("actual_qd", qd, 0),
        **numbered("actual_current", tau / CONSTANT, 0),
        **numbered("joint_temperatures", 30 + q, 0),
        "runtime_state": np.full(len(t), 2.0),
    }
    run = one(csv(tmp_path / "robot_data.csv", columns, " "), arm)
    assert run.time[0] == 4029.5
    np.testing.assert_allclose(run.position, q + 1e-3, atol=1e-8)
    np.testing.assert_allclose(run.torque, tau, atol=1e-7)
    assert run.torque_from == "current"
    np.testing.assert_allclose(run.temperature, 30 + q, atol=1e-7)
    np.testing.assert_allclose(run.plan.position, q, atol=1e-8)
    np.testing.assert_allclose(run.plan.acceleration, qdd, atol=1e-8)
    assert run.simulated is None


def test_targets_logged_ahead_of_the_motion_are_moved_back(tmp_path, arm):
    t = times(20.0)
    columns = recording(t, **numbered("target_q", motion(t + 1.4)[0]))
    run = one(parquet(tmp_path / "a.parquet", columns), arm)
    np.testing.assert_allclose(run.plan.position, run.position, atol=1e-3)
    assert run.time[0] == pytest.approx(1.4, abs=0.0081)
    assert any("1.40 s ahead" in note for note in run.notes)


async def recorded_by_cellwatt(folder, t):
    """Frames at 50 Hz."""
    q, qd, _, tau = motion(t)
    recorder = Recorder(RecordSettings(folder=folder), Header("plant-1", "bench", START))
    recorder.start()
    assert recorder.put(framed(LAYOUT, np.column_stack([q, qd, tau, 100 + t])))
    await recorder.close()


async def test_cellwatts_own_recordings(tmp_path, arm):
    t = times(rate=50.0)
    await recorded_by_cellwatt(tmp_path, t)
    (file,) = tmp_path.glob("*.mcap")
    for path in (file, tmp_path):
        run = one(path, arm)
        assert run.step == pytest.approx(0.02)
        np.testing.assert_array_equal(run.position, motion(t)[0])
        np.testing.assert_array_equal(run.torque, motion(t)[3])
        np.testing.assert_array_equal(run.power, 100 + t)


def test_currents_need_torque_constants(tmp_path):
    arm = Arm.load(write_robot(tmp_path, torque_constant=0.0))
    columns = recording(times())
    for i in range(JOINTS):
        columns[f"current_{i + 1}"] = columns.pop(f"tau_{i + 1}")
    message = refused(parquet(tmp_path / "a.parquet", columns), arm)
    assert "torque_constant of axis_1, axis_2" in message


@pytest.mark.parametrize("name", ["torque_percent_{}", "tau_{} [%]"])
def test_shares_of_the_rated_torque_are_torques(tmp_path, arm, name):
    rated = [joint.model_copy(update={"rated_torque": 50.0}) for joint in arm.description.joints]
    robot = arm.description.model_copy(update={"joints": tuple(rated)})
    columns = recording(times())
    for i in range(JOINTS):
        columns[name.format(i + 1)] = columns.pop(f"tau_{i + 1}") / 0.5
    (run,) = read_runs([parquet(tmp_path / "a.parquet", columns)], [], robot)
    np.testing.assert_allclose(run.torque, motion(times())[3])


def test_uneven_times_are_brought_onto_an_even_grid(tmp_path, arm):
    random = np.random.default_rng(4)
    t = times() + random.uniform(-0.3, 0.3, len(times())) / RATE
    run = one(parquet(tmp_path / "a.parquet", recording(t)), arm)
    steps = np.diff(run.time)
    assert np.ptp(steps) < 1e-9
    assert steps[0] == pytest.approx(np.median(np.diff(t)))
    q, _, _, tau = motion(run.time)
    assert np.max(np.abs(run.position - q)) < 1e-4
    assert np.max(np.abs(run.torque - tau)) < 1e-3
    assert not run.gaps.any()


def test_holes_in_time_are_marked_with_what_their_filling_smooths(tmp_path, arm):
    t = times()
    kept = (t < 3.0) | (t > 3.4)
    run = one(parquet(tmp_path / "a.parquet", recording(t[kept])), arm)
    assert len(run.time) == len(t)
    np.testing.assert_array_equal(run.gaps, (t > 2.84) & (t < 3.56))
    np.testing.assert_allclose(run.position[kept], motion(t)[0][kept], atol=1e-9)


def test_a_slow_simulation_leaves_no_share_of_the_jerk(tmp_path, arm):
    """Straight lines would lack step² / 8 of the acceleration's second derivative, as an elastic joint does."""
    recorded = parquet(tmp_path / "run.recording.parquet", recording(times()))
    simulated = parquet(tmp_path / "run.simulation.parquet", simulation(times(rate=10.0)))
    (run,) = read_runs([recorded], [simulated], arm.description)
    jerked = -((0.5 + 0.2 * np.arange(JOINTS)) ** 2) * motion(run.time)[2]
    off = run.plan.acceleration - motion(run.time)[2]
    inside = slice(20, -40)
    share = np.sum(off[inside] * jerked[inside], axis=0) / np.sum(jerked[inside] ** 2, axis=0)
    assert np.all(np.abs(share) < 0.05 * 0.1**2 / 8)


def test_a_simulation_on_another_clock_is_lined_up_by_the_motion(tmp_path, arm):
    t = times(20.0)
    seen = parquet(tmp_path / "seen.parquet", {**recording(t), "t": t + 1e6})
    said = parquet(tmp_path / "said.parquet", {**simulation(t + 2.0), "t": t})
    (run,) = read_runs([seen], [said], arm.description)
    assert run.time[0] == pytest.approx(1e6 + 2.0, abs=0.0081)
    np.testing.assert_allclose(run.plan.position, run.position, atol=1e-3)
    assert any("different clocks" in note for note in run.notes)
    assert any("2.00 s of the recording lie outside" in note for note in run.notes)


def test_a_simulation_that_covers_little_is_refused(tmp_path, arm):
    seen = parquet(tmp_path / "seen.parquet", recording(times()))
    said = parquet(tmp_path / "said.parquet", simulation(times(3.0)))
    assert "spans 0.00 to 2.99 s, the recording 0.00 to 7.99 s" in refused(seen, arm, [said])


def test_what_a_simulation_lacks_of_the_motion_is_derived(tmp_path, arm):
    t = times()
    q = motion(t)[0]
    seen = parquet(tmp_path / "seen.parquet", recording(t))
    said = parquet(tmp_path / "said.parquet", {"t": t, **numbered("q", q)})
    (run,) = read_runs([seen], [said], arm.description)
    inside = slice(50, -50)
    np.testing.assert_allclose(run.plan.velocity[inside], motion(t)[1][inside], atol=2e-3)
    np.testing.assert_allclose(run.plan.acceleration[inside], motion(t)[2][inside], atol=5e-3)
    assert run.simulated is None, "it says nothing of torque: robot.yaml does"


def test_few_unusable_values_are_filled_and_marked(tmp_path, arm):
    t = times()
    columns = recording(t)
    for row, value in ((200, np.nan), (201, np.inf), (500, -1e189)):
        columns["tau_3"][row] = value
    columns["q_2"][700] = 253.0
    run = one(parquet(tmp_path / "a.parquet", columns), arm)
    np.testing.assert_array_equal(np.flatnonzero(run.gaps), [200, 201, 500, 700])
    assert np.max(np.abs(run.torque - motion(t)[3])) < 1e-2
    assert np.max(np.abs(run.position - motion(t)[0])) < 1e-2
    assert any("3 unusable values of tau_3 filled in, first at t = 1.600 s" in note for note in run.notes)


def test_a_first_or_last_row_with_an_unusable_value_is_left_out_without_a_word(tmp_path, arm):
    t = times()
    columns = recording(t)
    columns["q_1"][0], columns["tau_2"][-1] = np.nan, 1e4
    run = one(parquet(tmp_path / "a.parquet", columns), arm)
    assert len(run.time) == len(t) - 2
    assert not run.filled.any()
    assert run.notes == one(parquet(tmp_path / "b.parquet", recording(t)), arm).notes
    np.testing.assert_array_equal(run.torque, motion(t)[3][1:-1])


@pytest.mark.parametrize(("rows", "held"), [(slice(999, 1000), False), (slice(0, 60), False), (slice(400, 500), True)])
def test_rows_in_which_nothing_was_read_do_not_count(tmp_path, arm, rows, held):
    """A program logs 0 until it receives something, and the last values while it receives nothing."""
    t = times()
    columns = recording(t)
    for name in columns.keys() - {"t"}:
        columns[name][rows] = columns[name][rows.start] if held else 0.0
    run = one(parquet(tmp_path / "a.parquet", columns), arm)
    rows = slice(rows.start + held, rows.stop)
    own = np.searchsorted(t, run.time[~run.filled] - 1e-6)
    assert not set(own) & set(range(*rows.indices(len(t))))
    assert len(own) >= len(t) - (rows.stop - rows.start) - 40
    assert np.max(np.abs(run.position[~run.filled] - motion(t)[0][own])) < 1e-9


def test_torques_of_single_rows_that_exceed_all_others_do_not_count(tmp_path, arm):
    columns = recording(times())
    columns["tau_2"][100:900:50] = 1e4
    run = one(parquet(tmp_path / "a.parquet", columns), arm)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(run.torque[:, 1])), np.arange(100, 900, 50))
    assert any("tau_2 has no number in 1.6 % of its rows" in note for note in run.notes)


def test_many_unusable_values_are_refused(tmp_path, arm):
    columns = recording(times())
    columns["q_3"][300:320] = np.nan
    message = "column q_3 has no usable number in 2.0 % of its rows, first at t = 2.400 s"
    assert message in refused(parquet(tmp_path / "a.parquet", columns), arm)


@pytest.mark.parametrize(("column", "attribute"), [("qd_3", "velocity"), ("power", "power")])
def test_velocity_and_power_with_many_unusable_values_are_not_used(tmp_path, arm, column, attribute):
    columns = recording(times())
    columns[column][300:320] = np.nan
    run = one(parquet(tmp_path / "a.parquet", columns), arm)
    assert getattr(run, attribute) is None
    assert not run.gaps.any()
    assert f"{column} has no usable number in 2.0 % of its rows, first at t = 2.400 s. It is not used" in run.notes[0]


def test_a_temperature_that_is_empty_leaves_the_temperatures_out(tmp_path, arm):
    t = times()
    columns = recording(t, **numbered("temperature", 30 + motion(t)[0]))
    columns["temperature_3"] = np.full(len(t), np.nan)
    run = one(parquet(tmp_path / "a.parquet", columns), arm)
    assert run.temperature is None
    assert run.notes == ("a.parquet: temperature_3 has no usable number: no temperature is used",)


def test_means_are_left_of_a_recording_that_is_short_beside_others(tmp_path, arm):
    short = read_signals(parquet(tmp_path / "a.parquet", recording(times(0.2))), arm.description)
    assert len(short.slower(2.0).time) >= 8


def changed(**changes):
    def change(columns):
        columns.update({name: function(columns) for name, function in changes.items()})

    return change


def without(*names):
    def change(columns):
        for name in names:
            del columns[name]

    return change


TAU = tuple(f"tau_{i + 1}" for i in range(JOINTS))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (without(*TAU), "no torque: expected tau_1, tau_2, … or current_1, current_2, …; there are: q_1"),
        (without("qd_6"), "5 joints in the columns qd_1 … qd_5, but the robot's description has 6 (axis_1, axis_2"),
        (changed(t=lambda c: np.minimum(c["t"], 5.0)), "374 of 1000 rows have no new time"),
        (changed(t=lambda c: c["t"] % 4.0), "the time goes back from 3.992 to 0.000 s in row 501"),
        (changed(t=lambda c: c["t"] + 1.7e9 * (c["t"] > 1)), "jumps from 1.000 to 1700000001.008 s in row 127: was"),
        (
            changed(t=lambda c: 0.096 * (np.arange(len(c["t"])) // 12) + 5e-5 * (np.arange(len(c["t"])) % 12)),
            "rows come several at once, 0.05 ms apart, and their positions do not show when they were sampled",
        ),
        (changed(t=lambda c: 1000 * c["t"]), "rises by 8 from row to row, in whole numbers: is it in milliseconds"),
    ],
)
def test_what_is_wrong_with_a_table_is_said_in_one_line(tmp_path, arm, change, message):
    columns = recording(times())
    change(columns)
    assert message in refused(parquet(tmp_path / "a.parquet", columns), arm)


@pytest.mark.parametrize(("seconds", "message"), [(-0.5, "the time goes back"), (1e6, "the time jumps")])
def test_a_wrong_time_is_named_by_its_row_in_the_spreadsheet(seconds, message, tmp_path, arm):
    """Below the row of names, with a row above it that has no position and is left out."""
    columns = recording(times())
    columns["t"][100:] += seconds
    for i in range(JOINTS):
        columns[f"q_{i + 1}"][50] = np.nan
    path = csv(tmp_path / "a.csv", columns)
    assert path.read_text().splitlines()[101].startswith(f"{columns['t'][100]:.10g},")
    text = refused(path, arm)
    assert message in text
    assert "s in row 102: " in text


def test_simulations_are_matched_by_name_or_by_place(tmp_path, arm):
    t = times()
    later = {name: values + (name[0] == "q" and name[1] == "_") for name, values in recording(t).items()}
    a = parquet(tmp_path / "a.recording.parquet", recording(t))
    b = parquet(tmp_path / "b.recording.parquet", later)
    sims = {}
    for name, shift in (("a.simulation", 0), ("b.simulation", 1), ("x", 0), ("y", 1)):
        columns = {n: v + shift * n.startswith("q_") for n, v in simulation(t).items()}
        sims[name] = parquet(tmp_path / f"{name}.parquet", columns)
    for simulations in ([sims["b.simulation"], sims["a.simulation"]], [sims["x"], sims["y"]]):
        for run in read_runs([a, b], simulations, arm.description):
            np.testing.assert_allclose(run.plan.position, run.position)
    first, second = read_runs([a, b], [sims["b.simulation"]], arm.description)
    assert first.plan is None
    assert second.plan is not None
    with pytest.raises(RecordingError, match="2 recordings but 1 simulations"):
        read_runs([a, b], [sims["x"]], arm.description)


def test_runs_of_the_same_name_carry_their_folders(tmp_path, arm):
    paths = []
    for folder in ("cold", "warm"):
        (tmp_path / folder).mkdir()
        paths.append(parquet(tmp_path / folder / "run.parquet", recording(times())))
    assert [run.name for run in read_runs(paths, [], arm.description)] == ["cold/run", "warm/run"]
    with pytest.raises(RecordingError, match="two recordings are called cold/run"):
        read_runs([paths[0], paths[0]], [], arm.description)


@pytest.mark.parametrize(("rate", "count"), [(1000.0, 4), (400.0, 2), (125.0, 1)])
def test_a_fast_recording_is_looked_at_in_means(tmp_path, arm, rate, count):
    t = times(rate=rate)
    jitter = np.random.default_rng(3).normal(0, 0.5, (len(t), JOINTS))
    columns = recording(t, **numbered("tau", motion(t)[3] + jitter))
    hole = slice(2000 * int(rate) // 1000, 2000 * int(rate) // 1000 + 8 * count)
    columns = {name: np.delete(values, hole) for name, values in columns.items()}
    (run,) = read_runs(
        [parquet(tmp_path / "a.parquet", columns)],
        [parquet(tmp_path / "s.parquet", simulation(times(9.0)))],
        arm.description,
    )
    q, qd, qdd, tau = motion(run.time)
    assert run.step == pytest.approx(count / rate)
    known = ~run.gaps
    for got, true in ((run.position, q), (run.velocity, qd), (run.plan.acceleration, qdd)):
        np.testing.assert_allclose(got[known], true[known], atol=1e-3)
    assert np.std((run.torque - tau)[known]) == pytest.approx(0.5 / np.sqrt(count), rel=0.1)
    assert 7 <= run.gaps.sum() <= 9
    assert len(one(parquet(tmp_path / "b.parquet", columns), arm).time) == len(run.time)


def test_a_measured_motion_is_taken_beside_its_simulation_whole(tmp_path, arm):
    """What the simulation does not cover is predicted, too: nothing is cut off."""
    t = times()
    measured = parquet(tmp_path / "a.parquet", {"t": t, **numbered("q", motion(t)[0] + 1e-4)})
    said = parquet(tmp_path / "s.parquet", simulation(times(7.5)))
    got, _ = read_motion(measured, said, arm.description)
    assert len(got.time) == len(t)
    np.testing.assert_allclose(got.plan.position[:740], motion(t)[0][:740], atol=1e-6)
    np.testing.assert_allclose(got.simulated.torque, motion(times(7.5))[3])
