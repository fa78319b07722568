from __future__ import annotations

import pytest

from cellwatt_drivers.yaskawa import YaskawaDriver, YaskawaSettings

from .rig import PULSES, RATED, Inlet

GOOD = {"host": "192.0.2.1", "pulses_per_degree": list(PULSES)}


def streams(**changes):
    driver = YaskawaDriver("arm", YaskawaSettings.model_validate(GOOD | changes), Inlet())
    return {s.name: s for s in driver.streams}


def test_without_rated_torque_there_is_no_newton_metre():
    assert {(c.name, c.unit) for c in streams()["torque"].channels} == {
        (f"joint_{i}.torque_ratio", "1") for i in range(1, 7)
    }
    rated = streams(rated_torque=list(RATED))["torque"]
    assert {(c.name, c.unit) for c in rated.channels} == {(f"joint_{i}.torque", "Nm") for i in range(1, 7)}


def test_the_state_stream_states_the_rate_it_really_has():
    assert streams(status_rate="3 Hz")["state"].rate == pytest.approx(50 / 17)
    assert streams(read=["status"], status_rate="80 Hz")["state"].rate == 80.0
    assert "robot.alarm_code" not in streams(read=["status"])["state"].names
