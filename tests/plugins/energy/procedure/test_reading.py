"""Readings at rest from a feed whose power is known."""

import numpy as np
import pytest

from cellwatt_plugins.energy.procedure.reading import KNOWN, take_reading

START = 1_795_000_000_000_000_000


class Played:
    """A feed that plays power at 10 Hz, three values a turn."""

    def __init__(self, power, joints=None, start=START):
        self._power, self._joints, self._start = power, joints, start
        self._taken = 0

    def take(self, seconds):
        self._taken = min(self._taken + 3, len(self._power))

    @property
    def time(self):
        return self._start + np.arange(self._taken) * 100_000_000

    @property
    def power(self):
        return self._power[: self._taken]

    @property
    def joints(self):
        return self._joints


def noise(count, watt, seed=1):
    return np.random.default_rng(seed).normal(0, watt, count)


def read(power, **more):
    shown = []
    taken = take_reading(Played(power, more.pop("joints", None)), shown.append, window=30.0, **more)
    return taken, shown


def test_the_mean_of_a_steady_power():
    power = 81.4 + noise(400, 0.08)
    taken, shown = read(power)
    assert taken.objections == ()
    assert taken.reading.power == pytest.approx(81.4, abs=4 * taken.reading.uncertainty)
    assert taken.reading.uncertainty < 0.02
    assert (taken.reading.end - taken.reading.start) * 1e-9 == pytest.approx(30, abs=0.2)
    assert "0 of 30 s" in shown[0]


def test_a_power_that_settles_is_waited_for():
    """It falls by 8 W within the first minute: a reading from the beginning would be 1 W too high."""
    t = np.arange(3000) / 10
    taken, _ = read(54.0 + 8 * np.exp(-t / 15) + noise(3000, 0.08))
    assert taken.objections == ()
    assert taken.reading.power == pytest.approx(54.0, abs=0.1)
    assert taken.reading.start > START + 30 * 10**9


def test_a_power_that_never_settles_is_objected_to():
    t = np.arange(1200) / 10
    taken, _ = read(50 + 0.05 * t + noise(1200, 0.08), patience=60.0)
    assert "not steady: drifted by +1.5" in taken.objections[0]


def test_a_power_that_switches_is_objected_to():
    """A fan of 6 W that comes and goes."""
    t = np.arange(1200) / 10
    taken, _ = read(50 + 6 * (np.sin(t) > 0.2) + noise(1200, 0.05), patience=60.0)
    assert taken.reading.uncertainty > KNOWN
    assert "something switches" in taken.objections[0]


@pytest.mark.parametrize(
    ("joints", "said"),
    [
        (np.array([0.1, -1.57, 0.0]), None),
        (np.array([0.1 + 2 * np.pi, -1.57, 0.01]), None),
        (np.array([0.1, -1.5, 0.2]), "not at the rest pose: joint 2 by 4.0, joint 3 by 11.5 deg away"),
        (np.array([0.1, -1.57]), "the arm has 2 joints, robot.yaml 3"),
        (np.array([0.1, np.nan, 0.0]), "is not known"),
        (None, "is not known"),
    ],
)
def test_the_arm_must_be_at_the_rest_pose(joints, said):
    taken, _ = read(81.4 + noise(400, 0.08), joints=joints, pose=np.array([0.1, -1.57, 0.0]))
    if said is None:
        assert taken.objections == ()
    else:
        assert said in taken.objections[0]


def test_an_analyzer_that_says_nothing(monkeypatch):
    seconds = iter(range(0, 1000, 7))
    monkeypatch.setattr("cellwatt_plugins.energy.procedure.reading.monotonic", lambda: next(seconds))
    taken, shown = read(np.zeros(0))
    assert taken is None
    assert shown == []
