"""Torques that were not recorded or not read, and joints that rest: no evidence, and no reason to refuse the rest."""

from dataclasses import replace

import numpy as np
import pytest

from cellwatt.errors import RecordingError
from cellwatt_plugins.explain.input.baseline import baseline
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.input.unread import without_unread
from tests.plugins.explain.input.reading import examine, read_runs
from tests.plugins.explain.logs import logged, measured, off_before, parquet
from tests.plugins.explain.recorded_arm import (
    COULOMB,
    JOINTS,
    excitation,
    points,
    recorded,
    some,
    without_plan,
)

NOT_USED = "It is not used; the other joints are"


@pytest.fixture(scope="module")
def run(described):
    return replace(recorded(described, points(seed=3)), velocity=None, power=None)


def read(folder, run, arm, first=1, **changes):
    """The run written as a table, some columns changed, or dropped where None, and read again."""
    (found,) = read_runs([logged(folder, run, first, **changes)], [], arm.description)
    return found


def silent(run):
    """Joints, from 1, without any torque; those with some have all."""
    missing = np.isnan(run.torque)
    assert (missing.all(axis=0) | ~missing.any(axis=0)).all()
    return (1 + np.flatnonzero(missing.all(axis=0))).tolist()


def counts(run, count, seed=0):
    """Noise of a converter that reads nothing: a few raw counts."""
    return count * np.random.default_rng(seed).integers(-2, 3, len(run.time))


@pytest.mark.parametrize(("joints", "first"), [((6,), 0), ((2, 5), 1)])
def test_a_column_may_be_absent_wherever_numbers_begin(joints, first, tmp_path, run, arm):
    found = read(tmp_path, run, arm, first, **{f"tau_{joint - 1 + first}": None for joint in joints})
    assert silent(found) == list(joints)
    heard = [i for i in range(JOINTS) if i + 1 not in joints]
    np.testing.assert_array_equal(found.torque[:, heard], run.torque[:, heard])
    (note,) = [note for note in examine([found], arm)[1] if NOT_USED in note]
    assert note.startswith(f"no torque of joint{'s' * (len(joints) > 1)} {', '.join(map(str, joints))}: ")


@pytest.mark.parametrize("size", [0.0, 1.0])
def test_an_empty_constant_or_idle_column_is_none(size, tmp_path, run, arm):
    dead = counts(run, size, seed=1)
    found = read(tmp_path, run, arm, tau_3=dead, tau_4=np.full(len(run.time), np.nan))
    assert silent(found) == [3, 4]
    assert sum(NOT_USED in note for note in examine([found], arm)[1]) == 1


@pytest.mark.parametrize("share", [0.002, 1.0])
def test_a_torque_that_goes_with_the_motion_is_kept_however_small_or_coarse(share, tmp_path, described, arm, run):
    turned = share * COULOMB[5] * np.tanh(run.plan.velocity[:, 5] / 0.004)
    coarse = np.round(run.torque[:, 1] / 40.0) * 40.0
    assert silent(read(tmp_path, run, arm, tau_6=turned, tau_2=coarse)) == []


def test_a_stretch_without_numbers_is_left_out_of_that_joint_alone(tmp_path, run, arm):
    torque = run.torque[:, 2].copy()
    torque[200:600] = np.nan
    found = read(tmp_path, run, arm, tau_3=torque)
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(found.torque[:, 2])), np.arange(200, 600))
    assert np.isfinite(found.torque[:, [0, 1, 3, 4, 5]]).all()
    assert not found.gaps.any()
    (note,) = [n for n in found.notes if "tau_3" in n]
    assert (
        f"tau_3 has no number in {100 * 400 / len(run.time):.1f} % of its rows, first at t = {run.time[200]:.3f} s"
        in note
    )
    examine([found], arm)


def test_a_sensor_that_dies_in_a_run_is_told(tmp_path, run, arm):
    torque = run.torque[:, 2].copy()
    torque[500:] = np.nan
    found = read(tmp_path, run, arm, tau_3=torque)
    (note,) = [n for n in found.notes if "tau_3" in n]
    assert f"after t = {run.time[499]:.3f} s, to the end at {run.time[-1]:.3f} s: its sensor failed" in note


def test_no_torque_at_all_is_refused(tmp_path, run, arm):
    nothing = {f"tau_{j + 1}": counts(run, 1e-3, seed=j) for j in range(JOINTS)}
    with pytest.raises(RecordingError, match=r"no torque is related to the motion: .*were the drives read"):
        examine([read(tmp_path, run, arm, **nothing)], arm)


def test_means_that_all_hold_a_filled_in_sample_are_too_few(tmp_path, described, arm):
    """Three rows of a millisecond in ten, of which means of four are taken."""
    run = without_plan(recorded(described, points(seed=3)))
    rows = np.arange(len(run.time))
    time = 1e-2 * (rows // 3) + 1e-3 * (rows % 3)
    position = np.column_stack([np.interp(time, run.time, one) for one in run.position.T])
    found = read(tmp_path, replace(run, time=time, position=position, velocity=None, power=None), arm)
    with pytest.raises(RecordingError, match="0 usable samples"):
        examine([found], arm)


def test_a_run_whose_drives_nobody_read_is_named_among_others(run, arm):
    silent = replace(run, name="silent", torque=np.full_like(run.torque, np.nan))
    with pytest.raises(RecordingError, match=r"silent: no torque is related to the motion: .*were the drives read"):
        examine([run, silent], arm)


def test_a_law_of_servos_is_not_mixed_with_torques_that_were_read(run, arm):
    with pytest.raises(RecordingError, match=r"commanded: .* explain it separately"):
        examine([run, replace(run, name="commanded", drive=object())], arm)


def test_torques_that_were_never_read_together_are_taken_each_for_itself(run, arm):
    torque, half = run.torque.copy(), len(run.time) // 2
    torque[half:, 2] = torque[:half, 4] = np.nan
    assert not any("torque" in note for note in examine([replace(run, torque=torque)], arm)[1])


def resting(described, joint):
    """A recording in which a joint rests while its encoder makes velocities of up to 0.037 rad/s."""
    run = recorded(described, some(excitation(seed=5), *(other for other in range(1, JOINTS + 1) if other != joint)))
    flicker = np.random.default_rng(6).choice([-0.037, 0.0, 0.0, 0.037], len(run.time))
    velocity, position = run.velocity.copy(), run.position.copy()
    velocity[:, joint - 1], position[:, joint - 1] = flicker, 0.25
    return replace(run, velocity=velocity, position=position)


def test_the_velocity_of_a_joint_at_rest_may_flicker(described, arm):
    run = without_plan(resting(described, 6))
    assert examine([run], arm)[1] == ["joint 6 never moved: friction and inertia there cannot be found"]


def test_numbers_of_a_joint_that_never_moves_are_not_found_from_a_simulation(described, arm):
    """Its simulation is run on noisy positions: what looks like friction there is rounding over next to nothing."""
    run = resting(described, 6)
    said, random = run.simulated, np.random.default_rng(7)
    plan = replace(
        said.plan,
        velocity=said.plan.velocity + np.outer(1e-9 * random.standard_normal(len(said.time)), np.eye(JOINTS)[5]),
        acceleration=said.plan.acceleration
        + np.outer(1e-7 * random.standard_normal(len(said.time)), np.eye(JOINTS)[5]),
    )
    torque = said.torque + np.outer(0.5 * np.sign(plan.velocity[:, 5]), np.eye(JOINTS)[5])
    torque[:, 1] *= 1.2
    law = baseline([replace(run, simulated=replace(said, plan=plan, torque=torque))], arm).arm
    for name in ("coulomb_friction", "viscous_friction", "rotor_inertia"):
        assert getattr(law.description.joints[5], name) == getattr(arm.description.joints[5], name)


@pytest.mark.parametrize("every", [1, 10])
def test_drives_that_are_off_at_rest_say_nothing_of_the_arm(every, tmp_path, run, arm):
    """Also if torque is read in every tenth row only; while drives are off, it may not be read at all."""
    rows = round(4 / run.step)
    before = {name: np.repeat(getattr(run, name)[:1], rows, axis=0) for name in ("position", "torque")}
    noise = np.random.default_rng(3).normal(0, 0.05, before["torque"].shape)
    time = run.time[0] + run.step * np.arange(rows + len(run.time))
    there = np.arange(len(time)) % every == 0
    for torque, counted in ((noise, 0), (np.nan * noise, 0), (before["torque"] + noise, rows)):
        position, torque = np.vstack([before["position"], run.position]), np.vstack([torque, run.torque])
        torque = np.where(there[:, None], torque, np.nan)
        found = read(tmp_path, replace(run, time=time, position=position, torque=torque), arm)
        heard = np.isfinite(found.torque).all(axis=1)
        assert np.mean(heard[rows:]) > 0.99 / every
        assert np.sum(heard[:rows]) == pytest.approx(counted / every, abs=0.1 / run.step)
        assert any("without torque at any joint" in note for note in found.notes) == (counted == 0)


def test_power_is_checked_although_the_drives_are_off_for_a_while(tmp_path, described, arm):
    run = without_plan(recorded(described, points(seed=3)))
    columns = measured(replace(run, power=1e-3 * run.power))
    for table in (columns, off_before(columns, 4.0, power=0.05)):
        with pytest.raises(RecordingError, match=r"is it in kW\? It must be in W"):
            examine(read_runs([parquet(tmp_path / "log.parquet", table)], [], arm.description), arm)


def test_power_of_braked_joints_between_two_motions_is_used(run):
    """Power before and after all motion is that of drives that are off, which the simulation does not have."""
    rest, half = round(60 / run.step), len(run.time) // 2
    rows = np.repeat(np.arange(len(run.time)), np.where(np.isin(np.arange(len(run.time)), [0, half]), rest, 1))
    braked = np.append(False, np.diff(rows) == 0)
    torque = np.where(braked[:, None], np.random.default_rng(3).normal(0, 0.05, (len(rows), JOINTS)), run.torque[rows])
    braked_run = Run("run", run.step * np.arange(len(rows)), run.position[rows], None, torque, power=0.0 * rows)
    found = without_unread(braked_run)
    assert without_unread(replace(braked_run, power=None)).gaps is None
    off = np.isnan(found.torque).all(axis=1)
    half = rest + len(run.time) // 4
    assert "run: 120 s at rest without torque at any joint, first at 0.00 s" in found.notes[0]
    np.testing.assert_array_equal(found.filled, off & (np.arange(len(off)) < half))
    assert [np.sum(off[:half]), np.sum(off[half:])] == pytest.approx([rest, rest], abs=0.2 / run.step)


@pytest.mark.parametrize(("joints", "rows"), [(JOINTS, 100), (1, 300), (1, 90), (JOINTS - 1, 90)])
def test_torques_that_stay_while_joints_move_are_not_used(joints, rows, described):
    run = recorded(described, excitation(1))
    torque = run.torque.copy()
    torque[400 : 400 + rows, :joints] = torque[400, :joints]
    found = without_unread(replace(run, torque=torque))
    missing = np.zeros(torque.shape, bool)
    missing[400 : 400 + rows, :joints] = rows > 90
    np.testing.assert_array_equal(np.isnan(found.torque), missing)
    assert [note for note in found.notes if "first at 4.00 s: it was not read there" in note] == [*found.notes]
    assert len(found.notes) == (rows > 90)
