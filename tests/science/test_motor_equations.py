"""The motor of Sabry et al., (1) to (14), turned with its inductance by an integrator of its own, against our law.

The law is quasi-static: it leaves out (6) to (8), (10) and (11), which are over within the winding's time constant.
What that costs is measured here.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cellwatt_plugins.robot import Joint, RobotDescription
from cellwatt_plugins.robot.drive import copper_loss, nominal_power

RESISTANCE, INDUCTANCE, CONSTANT, INERTIA, VISCOUS = 0.9, 2e-3, 12.0, 4.0, 8.0
"""Ω, H, Nm/A = V s/rad at the joint, kg m², Nm s/rad; the winding settles in L/R = 2.2 ms."""
STANDBY, EFFICIENCY = 60.0, 0.9
STEP = 1e-4  # s


@pytest.fixture
def robot(tmp_path):
    joint = Joint(name="joint", torque_constant=CONSTANT, winding_resistance=RESISTANCE)
    return RobotDescription(
        robot="motor", urdf=tmp_path, joints=(joint,), standby_power=STANDBY, converter_efficiency=EFFICIENCY
    )


def driven(voltage, load, seconds):
    """Velocity and current (N,) by (3), (4), (9) and (10) for a voltage of time and a constant load, Nm."""

    def slopes(t, state):
        velocity, current = state
        turning = (CONSTANT * current - load - VISCOUS * velocity) / INERTIA
        return [turning, (voltage(t) - RESISTANCE * current - CONSTANT * velocity) / INDUCTANCE]

    times = np.arange(0, seconds, STEP)
    solved = solve_ivp(slopes, (0, seconds), [0.0, 0.0], t_eval=times, rtol=1e-9, atol=1e-9, max_step=1e-3)
    return times, solved.y[0], solved.y[1]


def test_at_rest_a_motor_takes_what_4_of_the_static_paper_says(robot):
    """Held by a torque it cannot turn against, with the voltage that its winding needs: P = τ V / K_t."""
    torque = 30.0
    voltage = RESISTANCE * torque / CONSTANT
    _, velocity, current = driven(lambda t: voltage, torque, 0.2)
    assert abs(velocity[-1]) < 1e-3
    assert copper_loss(robot, np.array([[torque]])).item() == pytest.approx(torque * voltage / CONSTANT)
    assert copper_loss(robot, np.array([[torque]])).item() == pytest.approx(voltage * current[-1], rel=0.01)


@pytest.mark.parametrize("seconds", [0.5, 2.0])
def test_energy_of_a_move_is_13_and_14_within_what_the_inductance_adds(robot, seconds):
    """Up to speed and back; the law knows torque and velocity only, the integrator voltage and current."""
    top = 1.2 * CONSTANT
    times, velocity, current = driven(lambda t: top * np.sin(np.pi * t / seconds) ** 2 + 4.0, 20.0, seconds)
    voltage = top * np.sin(np.pi * times / seconds) ** 2 + 4.0
    drawn = np.trapezoid(voltage * current, dx=STEP)
    torque = (CONSTANT * current)[:, None]
    given = np.trapezoid((torque * velocity[:, None] + copper_loss(robot, torque))[:, 0], dx=STEP)
    stored = 0.5 * INDUCTANCE * current[-1] ** 2
    assert given == pytest.approx(drawn - stored, rel=1e-4)
    assert abs(stored) < 1e-3 * drawn
    watched = nominal_power(robot, torque, velocity[:, None])
    taken = np.where(voltage * current > 0, voltage * current / EFFICIENCY, 0.0)  # (14), and nothing given back
    assert np.trapezoid(watched, dx=STEP) == pytest.approx(STANDBY * seconds + np.trapezoid(taken, dx=STEP), rel=5e-3)


def test_the_inrush_of_11_is_over_before_a_board_at_123_hz_has_two_samples():
    """A joint that is blocked: I(t) rises to V / R by e^(−t R/L); what is left after 8.1 ms is below 3 %."""
    times, _, current = driven(lambda t: 2.0, 0.0, 0.05)
    blocked = 2.0 / RESISTANCE * (1 - np.exp(-times * RESISTANCE / INDUCTANCE))
    early = times < INDUCTANCE / RESISTANCE / 4  # before it has begun to turn
    assert current[early] == pytest.approx(blocked[early], rel=0.02)
    assert np.exp(-RESISTANCE / INDUCTANCE / 123) < 0.03
