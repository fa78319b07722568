from dataclasses import replace

import numpy as np
import pytest

from cellwatt_plugins.explain.fit.coordinate_search import at_bound, climb
from cellwatt_plugins.explain.fit.problem import Problem, Term
from cellwatt_plugins.explain.fit.rows import Thinned
from cellwatt_plugins.explain.fit.search import search
from cellwatt_plugins.explain.fit.sides import supply_problem, torque_problem
from cellwatt_plugins.explain.input.moved import moved
from cellwatt_plugins.robot.effects import BY_NAME
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import exact
from tests.plugins.explain import plant


def thinner(problem: Problem, every: int) -> Problem:
    """The same with every so many of its samples."""
    rows = tuple(Thinned(len(states.time), every, states.step) for states in problem.states)
    parts = {name: tuple(part[::every] for part in getattr(problem, name)) for name in ("target", "variance")}
    return replace(problem, rows=rows, **parts)


def searched(arm, missing, names, thin=1):
    runs = [plant.record("run_01", 1, missing), plant.record("run_02", 2, missing)]
    states = plant.states_of(runs, arm)
    return search(
        lambda turning, late: thinner(torque_problem(runs, states, turning, late), thin),
        plant.JOINTS,
        effects=[BY_NAME[name] for name in names],
    )


def places(solution):
    return {(name, joint + 1) for name, joint in (t.place for t in solution.terms)}


CHEAP = ("torque_offset", "stribeck_friction", "spring_load", "position_periodic_torque", "rotor_inertia")


def test_nothing_enters_where_there_is_noise_alone(arm):
    solution = searched(arm, plant.NOTHING, CHEAP)
    assert solution.terms == []
    assert solution.tried
    assert all(not trial.kept and trial.why for trial in solution.tried)


def test_an_error_of_the_last_link_is_not_named_beside_a_payload(arm):
    """The two turn the same joints by the same torques: one of them at most can be told."""
    carried = plant.Missing(arm=plant.loaded(plant.REAL, 3.0, 0.3))
    solution = searched(arm, carried, ("payload", "link_inertial_error"))
    assert [t.effect.name for t in solution.terms] == ["payload"]


@pytest.mark.parametrize(
    "real",
    [
        replace(plant.REAL, centres=(0.36, 0.21)),
        replace(plant.REAL, masses=(11.0, 4.3), centres=(0.30, 0.21), transverse=(0.33, 0.088)),
    ],
    ids=["centre", "all of it"],
)
def test_the_link_that_is_off_is_told_from_its_neighbours(arm, real):
    solution = searched(arm, plant.Missing(arm=real), ("link_inertial_error",))
    assert places(solution) == {("link_inertial_error", 2)}


@pytest.mark.parametrize("share", [0.3, 1.0])
def test_rotors_that_no_description_has_are_no_error_of_a_link(tmp_path, share):
    """An error of one link can stand for the rotors of two joints, and for each rotor alone there is less evidence."""
    bare = plant.load(plant.write_robot(tmp_path, rotor_inertia=0.0))
    rotors = [share * rotor for rotor in plant.REAL.rotor]
    missing = plant.Missing(arm=replace(plant.REAL, rotor=tuple(rotors)))
    solution = searched(bare, missing, ("link_inertial_error", "rotor_inertia"))
    assert places(solution) == {("rotor_inertia", joint) for joint in (1, 2, 3)}
    found = {term.joint: float(solution.coefficients(term)[0]) for term in solution.terms}
    assert [found[joint] for joint in range(3)] == pytest.approx(rotors, rel=0.1)


def test_a_delay_of_about_half_a_sample_is_how_torque_was_sampled(arm):
    run = plant.record("run_01", 1, plant.NOTHING)
    states = [States(run.name, 0, run.time, moved(run), arm)]
    for share, resolved in ((0.55, False), (-0.55, False), (0.65, True), (-0.65, True)):
        assert BY_NAME["time_delay"].resolved(states, None, (share / plant.RATE,)) == resolved
    # What is recorded every 40 ms was picked from steps of 10 ms or less.
    seldom = [replace(states[0], time=0.04 * np.arange(len(run.time)))]
    assert BY_NAME["time_delay"].resolved(seldom, None, (0.02,))
    assert not BY_NAME["time_delay"].resolved(seldom, None, (0.0055,))


def test_less_than_a_form_may_be_wrong_by_is_no_effect(arm):
    """Loss by hysteresis and eddy currents, which one power of speed does not follow in full."""

    def drawn(brakes):
        def power(time, power, qd):
            iron = 60 * np.sum(np.abs(qd) + qd**2, axis=1)
            return power + iron + brakes * np.any(qd != 0, axis=1)

        return power

    def found(brakes):
        missing = plant.Missing(drawn=drawn(brakes))
        runs = [plant.record(f"run_0{i}", i, missing, plan=True) for i in (1, 2)]
        states = plant.states_of(runs, arm)
        problem = supply_problem(runs, states, [np.zeros_like(s.torque) for s in states])
        effects = [BY_NAME["iron_loss"], BY_NAME["brake_power"]]
        return {t.effect.name for t in search(lambda *_: problem, 1, effects=effects).terms}

    assert found(0.0) == {"iron_loss"}
    assert found(15.0) == {"iron_loss", "brake_power"}


def short_moves(arm, seconds, real, rest=0.0):
    """Four moves with their power, of which ``rest`` W goes with the motion and no effect explains."""
    missing = plant.Missing(real, drawn=lambda time, power, qd: power + rest * np.sin(40 * np.sum(np.abs(qd), axis=1)))
    runs, states = [], []
    for i in range(4):
        course = plant.moves(i + 1, seconds, pause=0.1)
        runs.append(plant.record(f"run_0{i}", i + 1, missing, seconds, along=course))
        motion = course(runs[i].time - plant.LAG)
        there = States(f"run_0{i}", i, runs[i].time, exact(*motion), arm)
        states.append(there.with_torque(plant.motors(real, *motion)))
    problem = supply_problem(runs, states, [np.zeros_like(s.torque) for s in states])
    return lambda *_: problem


def test_a_few_short_moves_tell_standby_power_and_the_windings_heat(tmp_path):
    arm = plant.load(plant.write_robot(tmp_path, winding_resistance=0.0, standby_power=0.0))
    solution = search(short_moves(arm, 1.5, plant.REAL, rest=2.0), 1)
    found = {t.effect.name: solution.coefficients(t) for t in solution.terms}
    assert set(found) == {"standby_power", "copper_loss"}
    assert found["standby_power"] == pytest.approx([91.5], abs=1.5)
    assert found["copper_loss"] == pytest.approx(plant.REAL.resistance, rel=0.3)


def test_resistances_that_are_far_off_are_retuned_and_nothing_is_named_for_them(arm):
    real = replace(plant.REAL, resistance=(1.2, 1.0, 2.2), standby=100.0)
    solution = search(short_moves(arm, 5.0, real), 1)
    assert solution.terms == []
    standby, *resistance = solution.fit.coefficients
    assert standby == pytest.approx(10.0, abs=1.0)
    assert plant.NOMINAL.resistance * (1 + np.array(resistance)) == pytest.approx(real.resistance, rel=0.1)


def test_a_delay_of_one_joint_alone_is_no_delay_of_the_recording(arm):
    def late(torque):
        out = torque.copy()
        out[4:, 1] = torque[:-4, 1]
        return out

    assert searched(arm, plant.Missing(read=late), ("time_delay",)).terms == []
    (whole,) = searched(arm, plant.Missing(delay=4 / plant.RATE), ("time_delay",)).terms
    assert whole.shape[0] == pytest.approx(4 / plant.RATE, rel=0.05)


def test_a_clipped_torque_is_found_where_only_some_samples_are_fitted(arm):
    limit = 0.8 * np.max(np.abs(plant.record("run_01", 1, plant.NOTHING).torque[:, 1]))

    def clipped(torque):
        out = torque.copy()
        out[:, 1] = np.clip(torque[:, 1], -limit, limit)
        return out

    found = searched(arm, plant.Missing(read=clipped), ("torque_saturation",), thin=3)
    (term,) = found.terms
    assert term.place == ("torque_saturation", 1)
    assert term.shape[0] == pytest.approx(limit, rel=0.03)


def test_of_what_turns_over_at_random_the_mean_is_told(arm):
    """A contact of 8 Nm that is loose half of the time, now and then: 4 Nm hold on data left out, and no more."""

    def loose(time, q, qd, run):
        return plant.column(8.0 * (np.sin(2 * np.pi * 0.7 * time + 2 * np.sin(0.9 * time)) > 0), 3)

    found = searched(arm, plant.Missing(added=loose), ("torque_offset",))
    assert places(found) == {("torque_offset", 3)}
    # 34 turns a run of ±4 Nm tell the mean to about half a Nm.
    assert found.coefficients(found.terms[0])[0] == pytest.approx(4.0, abs=1.0)
    assert found.problem.chi2(found.residual)[2] > 10


def hill(*top):
    """Evidence that falls off with the square of the relative distance from ``top``."""

    def evidence(shape):
        return -sum(((x - t) / t) ** 2 for x, t in zip(shape, top, strict=True))

    return evidence


def test_climbing_reaches_the_top_and_stays_within_bounds():
    assert climb(hill(0.26), (0.2,), [(0.01, 1.0)]) == pytest.approx((0.26,), rel=0.02)
    assert climb(hill(5.0), (1.0,), [(0.5, 1.3)]) == pytest.approx((1.3,))


@pytest.mark.parametrize("top", [7e-5, 0.2])
def test_what_spans_decades_is_climbed_by_its_logarithm(top):
    def evidence(shape):
        return -(np.log(shape[0] / top) ** 2)

    (found,) = climb(evidence, (2 * top,), [(5e-5, 0.6)])
    assert found == pytest.approx(top, rel=0.05)
    assert not at_bound(Term(BY_NAME["presliding_hysteresis"], 0, (2e-4, 1.0)))
