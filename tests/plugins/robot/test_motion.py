import numpy as np
import pytest

from cellwatt_plugins.explain.input.moved import moved
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.robot.motion import (
    Plan,
    about_plan,
    differentiate,
    encoder_noise,
    exact,
    expected_sign,
    from_encoders,
    smooth,
)
from tests.plugins.explain import plant

STEP = 0.008
BANDWIDTH = 6.0


def transfer(angle):
    """Of the smoother that penalises third differences, one half at its bandwidth; ``angle`` in rad a sample."""
    return 1 / (1 + (np.sin(angle / 2) / np.sin(np.pi * BANDWIDTH * STEP)) ** 6)


def test_noise_left_in_position_velocity_and_acceleration_is_what_the_transfer_function_leaves():
    noise = np.random.default_rng(0).standard_normal((20000, 4))
    kept = smooth(noise, STEP, BANDWIDTH)
    angle = np.linspace(0, np.pi, 20001)[1:]
    slopes = np.ones_like(angle), np.sin(angle) / STEP, (2 * np.sin(angle / 2)) ** 2 / STEP**2
    for part, gain in zip((kept, *differentiate(kept, STEP)), slopes, strict=True):
        expected = np.sqrt(np.mean((transfer(angle) * gain) ** 2))
        assert np.std(part) == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("rate", [125.0, 1000.0, 2000.0, 8000.0])
def test_a_bandwidth_far_below_the_sampling_rate_passes_what_is_slower(rate):
    time = np.arange(30 * rate) / rate
    slow = np.sin(2 * np.pi * 0.1 * time)[:, None]
    inner = slice(round(5 * rate), -round(5 * rate))
    assert np.abs(smooth(slow, 1 / rate, 0.5) - slow)[inner].max() < 0.01


@pytest.mark.parametrize("count", range(1, 13))
@pytest.mark.parametrize("bandwidth", [0.5, 1.0])
def test_a_parabola_of_a_few_samples_of_a_high_rate_remains(count, bandwidth):
    time = np.arange(count) / 1000
    parabola = (1 + 2 * time + 300 * time**2)[:, None]
    assert np.abs(smooth(parabola, 1 / 1000, bandwidth) - parabola).max() < 2e-3


@pytest.mark.parametrize("spread", [0.0, 0.004, 0.03])
@pytest.mark.parametrize("velocity", [0.0, -0.006, 0.05])
def test_the_expected_sign_and_its_spread_are_those_of_drawn_velocities(velocity, spread):
    drawn = np.tanh((velocity + spread * np.random.default_rng(1).standard_normal(400_000)) / 0.004)
    mean, deviation = expected_sign(np.array([velocity]), np.array([spread]))
    assert mean[0] == pytest.approx(np.mean(drawn), abs=0.02)
    assert deviation[0] == pytest.approx(np.std(drawn), abs=0.02)


@pytest.mark.parametrize("sigma", [1e-6, 2e-3])
def test_encoder_noise_is_found_beneath_the_motion(sigma):
    t = np.arange(5000) * STEP
    motion = np.column_stack([np.sin(t), 2 * np.cos(0.7 * t)])
    noise = sigma * np.random.default_rng(2).standard_normal(motion.shape)
    assert encoder_noise(motion + noise) == pytest.approx([sigma, sigma], rel=0.08)


def test_positions_that_were_filled_in_show_no_encoder_noise():
    t = np.arange(5000) * STEP
    filled = (t > 0.2 * t[-1]) & (t < 0.8 * t[-1])
    motion = np.sin(t)[:, None] + np.where(filled, 0.0, 1e-4 * np.random.default_rng(2).standard_normal(5000))[:, None]
    swung = Plan(*(course[:, None] for course in (np.sin(t), np.cos(t), -np.sin(t))))
    for found in (from_encoders(motion, STEP, filled=filled), about_plan(motion, swung, STEP, filled)):
        assert found.resolution == pytest.approx([1e-4], rel=0.08)


def test_rests_are_no_sample_of_a_coarse_encoders_noise():
    """Of a plan that rests for six tenths of the time; positions as files hold them, in single precision."""
    t = np.arange(5000) * STEP
    step, plan = 1e-4, np.sin(np.clip(t, 0.4 * t[-1], 0.8 * t[-1]))[:, None]
    rounded = (step * np.round(plan / step)).astype(np.float32).astype(float)
    assert encoder_noise(rounded, plan)[0] == pytest.approx(step / np.sqrt(12), rel=0.3)
    moved = about_plan(rounded, Plan(plan, *differentiate(plan, STEP)), STEP)
    assert np.abs(moved.acceleration - differentiate(plan, STEP)[1]).max() < 0.05


def test_a_hole_shows_nothing_of_how_the_plan_was_followed():
    """Across 2 s without encoders, the arm did what its plan says, with the tracking error before and after."""
    time = np.arange(0, 20, STEP)
    q = np.column_stack([np.sin(2 * np.pi * 0.4 * time), 0.7 * np.cos(2 * np.pi * 0.55 * time)])
    plan = Plan(q, *differentiate(q, STEP))
    true = q + 2e-3 * np.sin(2 * np.pi * 0.1 * time)[:, None]
    encoders = true + 2e-5 * np.random.default_rng(1).standard_normal(q.shape)
    hole = (time > 8) & (time < 10)
    rows = np.arange(len(time))
    bridged = np.column_stack([np.interp(rows, rows[~hole], course[~hole]) for course in encoders.T])
    whole, found = about_plan(encoders, plan, STEP), about_plan(bridged, plan, STEP, hole)
    for part in ("velocity", "acceleration"):
        apart = getattr(found, part) - getattr(whole, part)
        assert np.std(apart[~hole]) < 0.01 * np.std(getattr(plan, part))


def test_the_motion_without_a_plan_is_that_of_the_arm():
    run = plant.record("run_01", 3, plan=False)
    q, qd, qdd = plant.moves(3, 24.0)(run.time - plant.LAG)
    found = moved(run)
    assert np.std(found.position - q) < plant.ENCODER_NOISE
    assert np.std(found.velocity - qd) < 0.05 * np.std(qd)
    assert np.std(found.acceleration - qdd) < 0.2 * np.std(qdd)


def test_the_motion_with_a_plan_follows_the_arm_and_not_the_plan():
    """The arm swings about its plan at 1 Hz, by more than the encoders' noise."""
    time = np.arange(2000) / 100
    q, qd, qdd = plant.moves(4, 20.0)(time)
    swing = 0.02 * np.sin(2 * np.pi * time)[:, None]
    off = 0.02 * 2 * np.pi * np.cos(2 * np.pi * time)[:, None]
    noise = 2e-5 * np.random.default_rng(4).standard_normal(q.shape)
    run = Run("run_01", time, q + swing + noise, None, np.zeros_like(q), plan=Plan(q, qd, qdd))
    found = moved(run)
    assert np.std(found.velocity - (qd + off)) < 0.05 * np.std(off)
    assert np.std(found.acceleration - (qdd - (2 * np.pi) ** 2 * swing)) < 0.1 * np.std((2 * np.pi) ** 2 * swing)


def test_the_sign_is_doubtful_at_stops_and_certain_at_speed():
    run = plant.record("run_01", 6, plan=False)
    _, qd, _ = plant.moves(6, 24.0)(run.time - plant.LAG)
    found = moved(run)
    fast, still = np.abs(qd) > 0.2, np.abs(qd) < 1e-4
    assert np.mean(found.sign_spread[still]) > 10 * np.mean(found.sign_spread[fast])
    assert np.mean(np.abs(found.sign[still])) < 0.2
    assert np.mean(found.sign_spread[fast]) < 0.01
    assert np.array_equal(np.sign(found.sign[fast]), np.sign(qd[fast]))


@pytest.mark.parametrize("lag", [0.0, 0.013])
def test_a_servo_that_lags_behind_moves_as_planned_but_later(lag):
    course = plant.moves(3, 20.0)
    time = np.arange(2500) * STEP
    plan, really = course(time), course(time - lag)
    noise = 2e-5 * np.random.default_rng(0).standard_normal(plan[0].shape)
    run = Run("run_01", time, really[0] + noise, None, plan[1], None, None, Plan(*plan))
    found = moved(run)
    assert np.sqrt(np.mean((found.velocity - really[1]) ** 2)) < 0.002
    assert np.sqrt(np.mean((found.acceleration - really[2]) ** 2)) < 0.03 * np.std(really[2])


def test_an_arm_that_sticks_at_a_reversal_is_followed_off_its_plan():
    """It stands for 40 ms where the plan turns back, then catches up within 100 ms."""
    step = 0.004
    time = np.arange(3000) * step
    swing, turn = 2 * np.pi * 0.5, 0.5
    plan = (np.sin(swing * time), swing * np.cos(swing * time), -(swing**2) * np.sin(swing * time))
    since = time - turn
    held = np.sin(swing * (turn - 0.02)) - plan[0]
    share = np.where((since > -0.02) & (since < 0.02), 1.0, np.where(since < 0, 0.0, np.exp(-since / 0.03)))
    q = (plan[0] + np.where(since > -0.02, share * held, 0.0))[:, None]
    noise = 3e-6 * np.random.default_rng(1).standard_normal(q.shape)
    commanded = Plan(*(part[:, None] for part in plan))
    found = moved(Run("run_01", time, q + noise, None, np.zeros_like(q), plan=commanded))
    stuck = np.abs(since) < 0.012
    assert np.abs(plan[1][stuck]).max() > 0.07
    assert np.abs(found.velocity[stuck]).max() < 0.03
    assert found.turning().held[stuck].min() > 0.2
    assert found.turning().held[np.abs(found.velocity) > 0.15].max() < 0.01


def test_friction_that_leads_turns_over_before_the_velocity():
    speed = np.linspace(0.1, -0.1, 21)[:, None]
    known = exact(np.zeros_like(speed), speed, np.full_like(speed, -4.0))
    assert np.argmax(known.turning().sign[:, 0] < 0) == 11
    assert np.argmax(known.turning(0.01).sign[:, 0] < 0) == 7
