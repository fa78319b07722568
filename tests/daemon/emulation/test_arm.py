"""The emulated arm obeys the physics it claims, checked by differentiation and energy balance."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt.emulation import ArmSignals


def test_velocity_and_acceleration_are_derivatives_of_position() -> None:
    arm = ArmSignals()
    t = np.linspace(0, arm.period, 8001)
    q, w, a = arm.motion(t)
    np.testing.assert_allclose(np.gradient(q, t, axis=0)[2:-2], w[2:-2], atol=2e-3)
    np.testing.assert_allclose(np.gradient(w, t, axis=0)[2:-2], a[2:-2], atol=0.15)  # the jerk jumps at each onset


def test_moves_start_where_they_say() -> None:
    arm = ArmSignals()
    _, w, _ = arm.motion(np.linspace(0, arm.period, 8001))
    t = np.linspace(0, arm.period, 8001)
    moving = np.abs(w[:, 2]) > 1e-3
    onsets = t[1:][moving[1:] & ~moving[:-1]]
    np.testing.assert_allclose(onsets, arm.starts(3), atol=0.03)


def test_spring_acts_from_its_time_on_and_stores_what_it_takes() -> None:
    healthy, sprung = ArmSignals(noise=0), ArmSignals(noise=0)
    sprung.disturb({"spring": 3, "stiffness": 60.0, "rest": 1.4, "at": 5.0})
    t = np.linspace(0, 4 * healthy.period, 40001)
    extra = sprung.at(t)["joint_3.torque"] - healthy.at(t)["joint_3.torque"]
    assert not extra[t < 5.0].any()
    q, w, _ = healthy.motion(t)
    late = t >= healthy.period
    np.testing.assert_allclose(extra[late], 60.0 * (q[late, 2] - 1.4), atol=1e-9)
    # Over whole repetitions an ideal spring gives back all the work it took.
    work = np.trapezoid((extra * w[:, 2])[late], t[late])
    assert abs(work) < 1e-3 * np.trapezoid(np.abs(extra * w[:, 2])[late], t[late])


def test_encoder_offset() -> None:
    arm = ArmSignals(noise=0)
    arm.disturb({"encoder": 2, "offset": 0.05, "at": 1.0})
    before, after = (
        arm.at(np.array([0.9, 1.1]))["joint_2.position"]
        - ArmSignals(noise=0).at(np.array([0.9, 1.1]))["joint_2.position"]
    )
    assert (before, after) == (0.0, pytest.approx(0.05))


def test_unknown_disturbance_is_refused() -> None:
    with pytest.raises(ValueError, match="spring and encoder"):
        ArmSignals().disturb({"wind": 3})
