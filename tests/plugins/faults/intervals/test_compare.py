import numpy as np
import pytest

from cellwatt_plugins.faults.criteria import Tolerance
from cellwatt_plugins.faults.intervals.compare import base_level, compare, power_agrees, steps
from cellwatt_plugins.faults.reference import LEAD, TAIL, Pattern, ReferenceInterval
from cellwatt_plugins.faults.trace import Trace

STEP = 0.02
LENGTH = 1.0
ONSET = 10_000_000_000
TOLERANCE = Tolerance()
REACH = 0.04


def path(t):
    s = np.clip(t / LENGTH, 0, 1)
    return 0.8 * (10 * s**3 - 15 * s**4 + 6 * s**5)


def watts(t):
    s = np.clip(t / LENGTH, 0, 1)
    return 100 + 300 * s**2 * (1 - s) ** 2 * 16 / 3


def made():
    t = -LEAD + STEP * np.arange(round((LEAD + LENGTH + TAIL) / STEP) + 1)

    def pattern(values):
        return Pattern(-LEAD, STEP, tuple(values.tolist()), (0.0,) * len(t))

    return ReferenceInterval((1,), (0.0, 0.3), (0.8, 0.0), LENGTH, 0.3, 5, pattern(watts(t)), {1: pattern(path(t))})


def trace(*, late=0.0, extra=lambda t: 0 * t, move=lambda t: 0 * t, speed=1.0):
    t = STEP * np.arange(round(-0.5 / STEP), round(2.0 / STEP))
    q = np.column_stack([path((t - late) * speed) + move(t), np.full(len(t), 0.3)])
    return Trace(ONSET + np.round(t * 1e9).astype(np.int64), q, watts((t - late) * speed) + extra(t))


def compared(given):
    return compare(made(), ONSET, given, TOLERANCE, REACH)


def test_a_healthy_run_has_no_residual():
    found = compared(trace())
    assert np.abs(found.power).max() < 1e-6
    assert np.abs(found.position).max() < 1e-6
    assert found.follows[2:-2].all()
    assert found.power_known == 1.0
    assert found.limit == pytest.approx(0.1 * watts(found.t), rel=1e-3)


@pytest.mark.parametrize("late", [-0.04, -0.02, 0.02, 0.04])
def test_an_onset_that_is_frames_off_has_none_either(late):
    found = compared(trace(late=late))
    assert not found.power_codes.any()
    assert not found.position_codes(TOLERANCE.position).any()


@pytest.mark.parametrize("late", [-0.14, -0.1, 0.1, 0.14])
def test_a_jolt_that_moved_the_onset_is_put_right(late):
    found = compared(trace(late=late))
    assert not found.power_codes.any()
    assert found.follows[4:-4].mean() > 0.9


def test_power_that_moves_off_is_seen_with_its_sign():
    more = compared(trace(extra=lambda t: 40 * path(t)))
    less = compared(trace(extra=lambda t: -40 * path(t)))
    assert more.power_codes.max() == 1 and more.power_codes.min() == 0
    assert less.power_codes.max() == 0 and less.power_codes.min() == -1
    assert more.follows[2:-2].all()


def test_the_level_before_the_onset_does_not_count():
    assert not compared(trace(extra=lambda t: 0 * t + 30)).power_codes.any()


def test_something_switched_on_in_between_does_not_count():
    assert not compared(trace(extra=lambda t: np.where(t >= 0.5, 30.0, 0.0))).power_codes[:-10].any()


def test_an_offset_of_the_encoder_does_not_follow():
    found = compared(trace(move=lambda t: 0 * t + 0.05))
    assert found.position[found.t > LENGTH, 0] == pytest.approx(0.05)  # at speed, a jitter explains a part of it
    assert found.position_codes(TOLERANCE.position)[found.t >= 0, 0].mean() > 0.4
    assert not found.follows[found.t > 0].any()


@pytest.mark.parametrize("speed", [0.6, 0.9, 1.1, 1.5])
def test_another_speed_does_not_follow(speed):
    found = compared(trace(speed=speed))
    assert not found.follows[found.t > 0.3].any()


def test_missing_power_is_neither_inside_nor_outside():
    given = trace(extra=lambda t: np.where(t > 0.3, np.nan, 60 * path(t)))
    found = compared(given)
    assert not found.power_codes[found.t > 0.3].any()
    assert found.power_known < 0.4


def test_base_level_is_the_median_before_the_onset():
    t = STEP * np.arange(-10, 20)
    residual = np.where(t <= 0, 7.0, 50.0)
    residual[8] = 300.0
    assert base_level(t, residual) == 7.0
    assert base_level(t, np.full(30, np.nan)) == 0.0


def test_steps_add_up_and_slopes_are_none():
    limit, calm = np.full(60, 10.0), np.ones(60, dtype=bool)
    residual = np.zeros(60)
    residual[20:] += 30
    residual[40:] -= 30
    found = steps(residual, limit, np.zeros(60), calm)
    assert found[[10, 30, 50]] == pytest.approx([0, 30, 0])
    assert not steps(np.linspace(0, 60, 60), limit, np.zeros(60), calm).any()
    assert not steps(residual, limit, np.full(60, 50.0), calm).any()
    assert not steps(residual, limit, np.zeros(60), ~calm).any()


def test_the_power_of_a_motion_that_encoders_do_not_show_is_found():
    given = trace(late=0.4)
    still = Trace(given.time, np.zeros_like(given.position), given.power)
    assert power_agrees(made(), still, ONSET, ONSET + 1_900_000_000, TOLERANCE, 5)
    quiet = Trace(given.time, still.position, np.full(len(given), 100.0))
    assert not power_agrees(made(), quiet, ONSET, ONSET + 1_900_000_000, TOLERANCE, 5)
    assert not power_agrees(made(), still, ONSET, ONSET + 500_000_000, TOLERANCE, 5)
