import numpy as np
import pytest

from cellwatt_plugins.robot.effects.load.schedule import levels

STEP = 0.01
SHORTEST = 0.4


def course(spans, count, low=0.0, high=1.0):
    out = np.full(count, low)
    for first, last in spans:
        out[first : last + 1] = high
    return out


def noisy(values, sigma, seed=0):
    return values + sigma * np.random.default_rng(seed).standard_normal(len(values))


def found(courses, weights=None):
    weights = [np.ones(len(c)) for c in courses] if weights is None else weights
    return levels(courses, weights, [STEP] * len(courses), SHORTEST)


@pytest.mark.parametrize("sigma", [0.0, 0.1, 0.4])
def test_stretches_are_found_to_some_samples(sigma):
    spans = [(300, 799), (1200, 1350)]
    got = found([noisy(course(spans, 2000), sigma)])
    assert [run for run, _, _ in got] == [0, 0]
    for (_, first, last), (start, end) in zip(got, spans, strict=True):
        assert abs(first - start) <= 3 + 10 * sigma
        assert abs(last - end) <= 3 + 10 * sigma


def test_runs_are_told_apart_and_their_ends_are_no_switches():
    got = found([noisy(course([(600, 999)], 1000), 0.2), noisy(course([(0, 399), (700, 799)], 1000), 0.2, 1)])
    assert [run for run, _, _ in got] == [0, 1, 1]
    assert got[0][2] == 999
    assert got[1][1] == 0


def test_a_course_without_levels_has_no_stretches():
    assert found([np.ones(1000)]) == []


@pytest.mark.parametrize("seed", range(2))
def test_noise_is_no_schedule_of_many_switches(seed):
    """Chance may leave a stretch or two, whose size is nothing; it must not be cut to pieces."""
    assert len(found([noisy(np.zeros(3000), 1.0, seed)])) <= 3


def test_samples_that_tell_nothing_do_not_count():
    values = noisy(course([(500, 1199)], 2000), 0.1)
    weight = np.ones(2000)
    values[1500:1700], weight[1500:1700] = 30.0, 1e-6
    ((_, first, last),) = found([values], [weight])
    assert (first, last) == (pytest.approx(500, abs=4), pytest.approx(1199, abs=4))


def test_a_stretch_that_the_recording_cuts_may_be_short():
    whole = course([(0, 19), (300, 699), (800, 819), (984, 999)], 1000)
    assert found([whole]) == [(0, 0, 19), (0, 300, 699), (0, 984, 999)]
