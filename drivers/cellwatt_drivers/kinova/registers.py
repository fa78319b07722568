"""The arm's input registers: the registers of each quantity, and registers ⇄ SI values.

Source: the Modbus ICD that Kinova publishes with its Kortex API. A value of 32 bits has two registers, the low word
first.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from cellwatt.arrays import Float
from cellwatt.channel import Channel, Stream

PORT = 502
MOST_JOINTS = 7
Block = Literal["arm", "joints", "tool"]

ARM = (0, 14)
"""First register and number of registers of the arm's block."""
JOINTS, JOINTS_AND_TOOL = (34, 70), (34, 106)

_RAD = math.radians(1.0)
_JOINT_ROWS = (("position", "rad", _RAD), ("velocity", "rad/s", _RAD), ("torque", "Nm", 1.0), ("current", "A", 1.0),
               ("temperature", "degC", 1.0))  # fmt: skip
# Angles wrap at 180 degrees, where interpolation between two samples is wrong: they are held.
_TOOL = (
    *((Channel(f"tool.{axis}", "m"), 1.0) for axis in "xyz"),
    *((Channel(f"tool.r{axis}", "rad", align="hold"), _RAD) for axis in "xyz"),
    *((Channel(f"tool.velocity_{axis}", "m/s"), 1.0) for axis in "xyz"),
    *((Channel(f"tool.velocity_r{axis}", "rad/s"), _RAD) for axis in "xyz"),
    *((Channel(f"tool.force_{axis}", "N"), 1.0) for axis in "xyz"),
    *((Channel(f"tool.torque_{axis}", "Nm"), 1.0) for axis in "xyz"),
)
ARM_CHANNELS = (
    Channel("bus.voltage", "V"),
    Channel("bus.current", "A"),
    Channel("bus.power", "W"),
    Channel("controller.temperature", "degC"),
    Channel("controller.ambient_temperature", "degC"),
    Channel("robot.state", "1", "discrete"),
    Channel("robot.fault_flags", "1", "discrete"),
    Channel("robot.warning_flags", "1", "discrete"),
)
STATES: Mapping[int, str] = {
    0: "unspecified", 1: "base initialising", 2: "idle", 3: "initialising", 4: "fault", 5: "maintenance",
    6: "low-level servoing", 7: "ready", 8: "running a sequence", 9: "guided by hand",
}  # fmt: skip
"""Names of the values of ``robot.state``."""


@dataclass(frozen=True, slots=True)
class Read:
    """One request: ``count`` registers from ``first`` on, and the stream of its values."""

    stream: Stream
    first: int
    count: int


def arm(rate: float) -> Read:
    """Request for supply, temperatures and state."""
    return Read(Stream("arm", ARM_CHANNELS, rate, "host"), *ARM)


def joints(rate: float, axes: int, tool: bool) -> Read:
    """One request for all values of the joints, and of the tool with ``tool``."""
    channels = [Channel(f"joint_{i}.{q}", unit) for q, unit, _ in _JOINT_ROWS for i in range(1, axes + 1)]
    if tool:
        channels += [channel for channel, _ in _TOOL]
    return Read(Stream("motion", tuple(channels), rate, "host"), *(JOINTS_AND_TOOL if tool else JOINTS))


def arm_values(registers: Sequence[int]) -> Float:
    """Values of ``ARM_CHANNELS`` from the arm's block."""
    current, voltage, cpu, ambient = _floats(registers[6:14])
    fault, warning = np.array(registers[2:6], dtype="<u2").view("<u4").tolist()
    return np.array([voltage, current, voltage * current, cpu, ambient, state_of(registers[0]), fault, warning])


def state_of(mask: int) -> float:
    """The number of the only state in a mask; NaN if it has none or several."""
    return float(mask.bit_length() - 1) if mask > 0 and mask & (mask - 1) == 0 else float("nan")


def motion_values(registers: Sequence[int], axes: int) -> Float:
    """Values of the ``motion`` stream from its block, in SI units; positions are not unwrapped, rad."""
    found = _floats(registers)
    joints = found[:35].reshape(5, MOST_JOINTS)[:, :axes] * np.array([[s] for _, _, s in _JOINT_ROWS])
    tool = found[35:] * np.array([s for _, s in _TOOL]) if len(found) > 35 else found[35:]
    return np.concatenate([joints.ravel(), tool])


def _floats(registers: Sequence[int]) -> Float:
    found = np.array(registers, dtype="<u2").view("<f4").astype(np.float64)
    found[np.isinf(found)] = np.nan
    return found


def encode(values: Sequence[float] | Float) -> list[int]:
    """Encode values as registers."""
    words: list[int] = np.array(values, dtype="<f4").view("<u2").tolist()
    return words


class Turns:
    """Makes angles that jump by a turn continuous; the first ones are within ± half a turn."""

    def __init__(self) -> None:
        self._last: Float | None = None

    def unwrap(self, angles: Float) -> Float:
        """Angles (axes,), rad, each within half a turn of the previous ones."""
        before = np.zeros_like(angles) if self._last is None else self._last
        found: Float = np.unwrap([before, angles], axis=0)[1]
        self._last = np.where(np.isnan(found), before, found)  # a NaN must not stay in a joint's angle for good
        return found
