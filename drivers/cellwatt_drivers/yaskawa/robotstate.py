"""The controller's status and alarm as channels and events."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cellwatt.channel import Channel
from cellwatt.driver import Inlet
from cellwatt_drivers.yaskawa.payload import Alarm, Mode, State, Status

ALARM_CODE = Channel("robot.alarm_code", "1", "discrete")
STATUS_CHANNELS = tuple(
    Channel(f"robot.{name}", "1", "discrete")
    for name in (
        "running",
        "servo_on",
        "hold",
        "alarm",
        "error",
        "remote",
        "play",
        "teach",
        "automatic",
        "one_cycle",
        "step",
        "speed_limited",
    )
)


def status_row(status: Status) -> NDArray[np.float64]:
    """0 or 1 for each of ``STATUS_CHANNELS``."""
    mode, state = status.mode, status.state
    bits = (
        mode & Mode.RUNNING,
        state & State.SERVO_ON,
        status.hold,
        state & State.ALARM,
        state & State.ERROR,
        mode & Mode.REMOTE,
        mode & Mode.PLAY,
        mode & Mode.TEACH,
        mode & Mode.AUTOMATIC,
        mode & Mode.ONE_CYCLE,
        mode & Mode.STEP,
        mode & Mode.SPEED_LIMITED,
    )
    return np.array([bool(b) for b in bits], dtype=np.float64)


class AlarmWatch:
    """Reports each alarm once when it appears, and once when none is left."""

    def __init__(self, source: str, inlet: Inlet) -> None:
        self._source = source
        self._inlet = inlet
        self._code = 0

    def see(self, alarm: Alarm) -> None:
        """Take what the controller says now; code 0 means no alarm."""
        if alarm.code == self._code:
            return
        self._code = alarm.code
        if alarm.code:
            detail = f"sub-data {alarm.data}, controller time {alarm.time or 'unknown'}"
            text = f"{self._source}: controller alarm {alarm.code} {alarm.name!r} ({detail})"
            self._inlet.event("controller_alarm", text, code=float(alarm.code), name=alarm.name)
        else:
            self._inlet.event("controller_alarm_cleared", f"{self._source}: the controller's alarm is gone")
