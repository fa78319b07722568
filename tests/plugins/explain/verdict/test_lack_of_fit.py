from functools import partial

import numpy as np

from cellwatt_plugins.explain.fit.search import search
from cellwatt_plugins.explain.fit.sides import torque_problem
from cellwatt_plugins.explain.verdict.lack_of_fit import lack_of_fit, unexplained_channel
from tests.plugins.explain import plant


def left(arm, added, **limits):
    """What is unexplained where no effect is known at all."""
    missing = plant.Missing(added=added)
    runs = [plant.record("run_01", 1, missing), plant.record("run_02", 2, missing)]
    states = plant.states_of(runs, arm)
    problem = torque_problem(runs, states)
    solution = search(partial(torque_problem, runs, states), plant.JOINTS, effects=())
    return lack_of_fit(problem.chi2(problem.fit([]).residual), solution, **limits)


def test_nothing_is_left_of_noise_and_mistuned_parameters(arm):
    assert left(arm, plant.NOTHING.added) == []


def test_joints_that_the_search_had_no_time_for_are_not_called_unexplained(arm):
    missing = plant.Missing(added=lambda t, q, qd, run: plant.column(4 * np.sin(3 * t), 3))
    runs = [plant.record("run_01", 1, missing, power=False)]
    solution = search(partial(torque_problem, runs, plant.states_of(runs, arm)), plant.JOINTS, until=-np.inf)
    assert solution.unsearched == (0, 1, 2)
    (late,) = [u for u in lack_of_fit(np.ones(3), solution) if u.channel == 2]
    told = unexplained_channel(late, "tau_3", "N*m", looked_at=False)
    assert not told.looked_at
    assert "not looked at in full: the time limit was reached" in told.statement
    assert "no known effect" not in told.statement


def test_the_time_is_told(arm):
    def at_times(time, q, qd, run):
        on = (run == "run_02") & (time > 9) & (time < 15)
        return plant.column(on * 8 * np.sign(np.sin(2 * np.pi * 0.7 * time)), 3)

    (found,) = left(arm, at_times)
    assert found.channel == 2
    assert found.times
    for span in found.times:
        assert span.recording == "run_02"
        assert span.start > 8
        assert span.end < 16


def test_the_position_is_told(arm):
    (found,) = left(arm, lambda t, q, qd, run: plant.column(25 * np.exp(-(((q[:, 0] - 0.5) / 0.08) ** 2)), 1))
    assert found.channel == 0
    low, high = found.position
    assert low < 0.5 < high
    # Of the 2.8 rad that the joint covers.
    assert high - low < 1.8
    said = unexplained_channel(found, "tau_1", "N*m")
    assert said.channel == "tau_1"
    assert said.statement.startswith("tau_1 has a residual of")
    assert "rad" in said.statement
    assert said.noise_floor == found.floor


EIGHTH = {"size": 0.12}
"""Beside the noise of the plant's torques."""


def test_what_is_small_but_where_it_acts_is_told(arm):
    """The same mean square: a hum that is always there, and knocks that act now and then."""
    hum = 1.6 * plant.TORQUE_NOISE[1]

    def knocks(time, q, qd, run):
        on = np.mod(time, 3.1) < 0.25
        return plant.column(on * hum / np.sqrt(np.mean(on)) * np.sign(np.sin(2 * np.pi * 9 * time)), 2)

    measured = np.std(plant.record("run_01", 1, plant.Missing()).torque[:, 1])
    assert 0.05 * measured < hum < 0.1 * measured
    always = np.sqrt(2) * hum
    assert left(arm, lambda t, q, qd, run: plant.column(always * np.sin(2 * np.pi * 9 * t), 2), **EIGHTH) == []
    (found,) = left(arm, knocks, **EIGHTH)
    assert found.channel == 1
