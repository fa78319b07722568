"""The controller's status and alarm as channels and events, and a check for impossible torques.

Public sources do not agree on a controller's encoding of torques.
"""

from __future__ import annotations

from cellwatt.channel import Channel
from cellwatt.driver import Inlet
from cellwatt_drivers.yaskawa import payload

ALARM_CODE = Channel("robot.alarm_code", "1", "discrete")
STATUS_CHANNELS = tuple(Channel(f"robot.{name}", "1", "discrete") for name in payload.STATUS_BITS)
LARGEST_SHARE = 10.0
"""Largest plausible share of the rated torque; servos give a few times the rated torque for a moment only."""


class AlarmWatch:
    """Reports each alarm once when it appears, and once when none is active."""

    def __init__(self, source: str, inlet: Inlet) -> None:
        self._source = source
        self._inlet = inlet
        self._code = 0

    def see(self, alarm: payload.Alarm) -> None:
        """Compare the controller's current alarm with the last one; code 0 means no alarm."""
        if alarm.code == self._code:
            return
        self._code = alarm.code
        if alarm.code:
            detail = f"sub-data {alarm.data}, controller time {alarm.time or 'unknown'}"
            text = f"{self._source}: controller alarm {alarm.code} {alarm.name!r} ({detail})"
            self._inlet.event("controller_alarm", text, code=float(alarm.code), name=alarm.name)
        else:
            self._inlet.event("controller_alarm_cleared", f"{self._source}: the controller's alarm is gone")


class TorqueWatch:
    """Reports once when torques become implausible; ``count`` is the share of the rated torque of one count.

    Public clients read answers to 0x77 as integers; Yaskawa's own dissector shows them as floats. A float read as an
    integer is implausibly large: 10.0 becomes 1,092,616,192.
    """

    def __init__(self, source: str, inlet: Inlet, count: float) -> None:
        self._source = source
        self._inlet = inlet
        self._count = count
        self._told = False

    def see(self, data: bytes) -> None:
        """Check the data of a valid answer."""
        counts = payload.decode_axes(data)
        strange = [n for n, value in enumerate(counts) if abs(value) * self._count > LARGEST_SHARE]
        if not strange:
            self._told = False
        elif not self._told:
            self._told = True
            axis = strange[0]
            text = f"reads {counts[axis]} counts, {counts[axis] * self._count:.3g} times the rated one"
            hint = "see torque_count; does this controller send floats?"
            self._inlet.event("implausible_torque", f"{self._source}: torque of joint {axis + 1} {text}: {hint}")
