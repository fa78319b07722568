"""Polls of the slots: the request, its stream, and the conversion of its data to values."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt.channel import Channel, Stream
from cellwatt.errors import ProtocolError
from cellwatt_drivers.yaskawa import payload, wire
from cellwatt_drivers.yaskawa.robotstate import ALARM_CODE, STATUS_CHANNELS

_CARTESIAN_INSTANCE = 100
_POSE_UNITS = np.array([payload.METRES] * 3 + [math.radians(payload.DEGREES)] * 3)
# Angles wrap at 180 degrees, where interpolation between two samples is wrong: they are held.
_POSE_CHANNELS = tuple(Channel(f"tool.{axis}", "m") for axis in "xyz") + tuple(
    Channel(f"tool.r{axis}", "rad", align="hold") for axis in "xyz"
)


@dataclass(frozen=True, slots=True)
class Poll:
    """One request, its stream, and the number of slots from one to the next.

    ``values`` (channels,) raises ``ProtocolError`` for invalid data.
    """

    stream: Stream
    request: wire.Request
    values: Callable[[bytes], Float]
    every: int = 1


def motor_angles(
    pulses_per_degree: Sequence[float],
    coupling: Sequence[Sequence[float]] | None = None,
    zero: Sequence[float] | None = None,
) -> Callable[[Sequence[int]], Float]:
    """Joint angles (n,) rad of n pulses: coupling · (pulses × rad per pulse) + zero (rad at pulse 0)."""
    pulse = math.radians(1.0) / np.array(pulses_per_degree, dtype=np.float64)
    matrix = np.eye(len(pulse)) if coupling is None else np.array(coupling, dtype=np.float64)
    offset = np.zeros(len(pulse)) if zero is None else np.array(zero, dtype=np.float64)
    return lambda pulses: matrix @ (np.array(pulses, dtype=np.float64) * pulse) + offset


def position(group: int, rate: float, axes: int, angles: Callable[[Sequence[int]], Float]) -> Poll:
    """Poll of joint angles, rad."""

    def values(data: bytes) -> Float:
        return angles(_first(axes, payload.decode_position(data, payload.PULSE)))

    return Poll(_joints("position", rate, axes, "position", "rad"), wire.Request(wire.POSITION, group), values)


def torque(group: int, rate: float, axes: int, rated: Sequence[float] | None, count: float) -> Poll:
    """Poll of joint torques: Nm if the ``rated`` ones (axes,) are known, else as a share of the rated torque.

    ``count`` is the share of the rated torque per count of the answer.
    """
    per_count = np.array(rated or [1.0] * axes, dtype=np.float64) * count
    quantity, unit = ("torque", "Nm") if rated else ("torque_ratio", "1")

    def values(data: bytes) -> Float:
        torques: Float = np.array(_first(axes, payload.decode_axes(data)), dtype=np.float64) * per_count
        return torques

    return Poll(_joints("torque", rate, axes, quantity, unit), wire.Request(wire.TORQUE, group), values)


def cartesian(group: int, rate: float) -> Poll:
    """Poll of the tool's pose in the robot's base frame: m and rad."""

    def values(data: bytes) -> Float:
        axes = _first(6, payload.decode_position(data, payload.BASE))
        pose: Float = np.array(axes, dtype=np.float64) * _POSE_UNITS
        return pose

    stream = Stream("cartesian", _POSE_CHANNELS, rate, "host")
    return Poll(stream, wire.Request(wire.POSITION, _CARTESIAN_INSTANCE + group), values)


def status(rate: float, every: int, alarm: bool) -> Poll:
    """Poll of the controller's status in one of ``every`` slots; with ``alarm`` its stream also has the alarm's code.

    The code comes from another request: ``values`` do not include it.
    """

    def values(data: bytes) -> Float:
        return np.array([*payload.decode_status(data).values()], dtype=np.float64)

    stream = Stream("state", STATUS_CHANNELS + ((ALARM_CODE,) if alarm else ()), rate / every, "host")
    return Poll(stream, wire.Request(wire.STATUS), values, every)


def _joints(name: str, rate: float, axes: int, quantity: str, unit: str) -> Stream:
    channels = tuple(Channel(f"joint_{joint}.{quantity}", unit) for joint in range(1, axes + 1))
    return Stream(name, channels, rate, "host")


def _first(n: int, axes: tuple[int, ...]) -> tuple[int, ...]:
    if len(axes) < n:
        raise ProtocolError(f"the controller gives {len(axes)} axes, the settings say {n}")
    return axes[:n]
