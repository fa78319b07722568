"""Meters of many kinds put before an arm's power: what is found of them."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt_plugins.robot.meter.find import find
from cellwatt_plugins.robot.meter.held import held
from cellwatt_plugins.robot.meter.kinds import Course, kinds_of_power
from cellwatt_plugins.robot.meter.model import Meter, Readings
from tests.plugins.robot.slow_meter import shown

STEP = 0.008


class Arm:
    """Two joints that go to and fro, with friction, gravity and drives of their own; its power is 60 W at rest."""

    def __init__(self, seconds: float = 60.0, seed: int = 0, noise: float = 0.3) -> None:
        draw = np.random.default_rng(seed)
        self.time = np.arange(0, seconds, STEP)
        q, qd, qdd = self._motion(draw)
        friction = np.array([6.0, 3.0]) * np.tanh(qd / 0.01) + np.array([8.0, 4.0]) * qd
        self.torque = np.array([3.0, 0.8]) * qdd + friction + np.array([40.0, 12.0]) * np.cos(q)
        drives = self.torque * qd + np.array([0.02, 0.05]) * self.torque**2 + np.array([2.0, 1.0]) * np.abs(qd)
        bus = drives.sum(axis=1)
        self.power = 60 + np.where(bus > 0, bus / 0.9, 0.3 * bus) + draw.normal(0, noise, len(bus))
        self.qd = qd + draw.normal(0, 0.003, qd.shape)
        self.measured = self.torque + draw.normal(0, 0.4, qd.shape)

    def _motion(self, draw: np.random.Generator) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Moves with quintic ramps and rests between them."""
        qdd = np.zeros((len(self.time), 2))
        for joint in (0, 1):
            at, side = draw.uniform(0.3, 0.8), 1.0
            while at < self.time[-1] - 2:
                takes = draw.uniform(0.5, 1.1)
                s = (self.time - at) / takes
                on = (s > 0) & (s < 1)
                qdd[on, joint] += side * 1.2 / takes**2 * (60 * s - 180 * s**2 + 120 * s**3)[on]
                at, side = at + takes + draw.uniform(0.0, 0.4), -side
        qd = np.cumsum(qdd, axis=0) * STEP
        return np.cumsum(qd, axis=0) * STEP, qd, qdd

    @property
    def position(self) -> np.ndarray:
        return np.cumsum(self.qd, axis=0) * STEP

    def joints(self, time: np.ndarray) -> np.ndarray:
        """Positions and torques (N, 4) as recorded at ``time`` (N,) s."""
        columns = np.hstack([self.position, self.measured]).T
        return np.column_stack([np.interp(time, self.time, column) for column in columns])

    @property
    def course(self) -> Course:
        return Course(self.time, kinds_of_power(self.measured, self.qd))

    def through(self, window: float, late: float, interval: float | None = None, phase: float = 0.4) -> np.ndarray:
        """Its power as such a meter shows it in the rows, each value held until the next."""
        return shown(self.time, self.power, window, late, interval=interval, phase=phase)


def found(arm: Arm, power: np.ndarray) -> Meter | None:
    readings = held([(arm.time, power)])
    assert readings is not None
    return find(readings, [arm.course])


@pytest.mark.parametrize("window", [0.05, 0.5])
@pytest.mark.parametrize("late", [0.0, 0.4])
def test_window_and_delay_of_a_meter_that_averages_from_value_to_value(window, late):
    arm = Arm()
    meter = found(arm, arm.through(window, late))
    assert meter is not None
    assert meter.window == pytest.approx(window, abs=0.01)
    assert meter.late == pytest.approx(late, abs=0.01)


def in_short_moves(window: float, late: float, count: int) -> Meter | None:
    """What is found of a meter in moves of three seconds."""
    arms = [Arm(3.0, seed) for seed in range(count)]
    powers = [arm.through(window, late, phase=seed * 0.37 % 1) for seed, arm in enumerate(arms)]
    readings = held([(arm.time, power) for arm, power in zip(arms, powers, strict=True)], window)
    return None if readings is None else find(readings, [arm.course for arm in arms])


def test_many_short_moves_do_as_well_as_a_long_recording():
    meter = in_short_moves(0.4, 0.35, 60)
    assert meter is not None
    assert meter.window == pytest.approx(0.4, abs=0.02)
    assert meter.late == pytest.approx(0.35, abs=0.02)


def test_moves_that_are_hardly_longer_than_the_window_tell_no_meter():
    assert in_short_moves(2.0, 0.9, 40) is None


@pytest.mark.parametrize(("window", "interval"), [(0.3, 0.1), (0.02, 0.2)])
def test_a_window_need_not_be_the_interval(window, interval):
    arm = Arm()
    meter = found(arm, arm.through(window, 0.15, interval))
    assert meter is not None
    assert abs(meter.window - window) < 3 * meter.window_spread
    assert meter.late + meter.window / 2 == pytest.approx(0.15 + window / 2, abs=0.01)


def drawn(seeds: range) -> list[tuple[bool, bool]]:
    """Whether the 95 % intervals hold window and delay of drawn meters."""
    out = []
    for seed in seeds:
        draw = np.random.default_rng(1000 + seed)
        window, late = float(draw.uniform(0.05, 0.5)), float(draw.uniform(0, 0.4))
        arm = Arm(float(draw.uniform(40, 120)), seed, noise=float(draw.uniform(0.1, 1.0)))
        meter = found(arm, arm.through(window, late, phase=float(draw.uniform())))
        assert meter is not None
        held_window = abs(meter.window - window) < 2 * meter.window_spread
        out.append((held_window, abs(meter.late - late) < 2 * meter.late_spread))
    return out


@pytest.mark.parametrize("count", [10, pytest.param(100, marks=pytest.mark.slow)])
def test_the_intervals_hold_the_truth(count):
    assert np.mean(drawn(range(count)), axis=0).min() >= 0.9


def test_a_meter_as_fast_as_the_rows_is_not_taken_for_a_slow_one():
    arm = Arm(20)
    assert held([(arm.time, arm.power)]) is None
    assert held([(arm.time, np.round(arm.power))]) is None, "steps of 1 W repeat at rest"
    quiet = Arm(20, noise=0.0)
    assert held([(quiet.time, np.round(quiet.power / 40) * 40)]) is None, "steps of 40 W repeat in motion, too"


def test_power_that_does_not_follow_the_motion_has_no_known_meter():
    arm = Arm(30)
    other = Arm(30, seed=9)
    meter = found(arm, other.through(0.1, 0.0))
    assert meter is None


def test_what_is_told():
    assert Meter(0.1, 0.15, 0.1, 0.002, 0.001).description == "averaged over 100 ± 4 ms and delayed by 150 ± 2 ms"
    assert Meter(0.1, 0.15, 0.1).description == "averaged over 100 ms and delayed by 150 ms"
    readings = Readings(np.array([2.0]), np.array([1.0]), 0.1)
    assert Meter(0.1, 0.15, 0.1).windows(readings).start.tolist() == pytest.approx([1.75])
