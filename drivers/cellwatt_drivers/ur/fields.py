"""Output fields of an RTDE controller: the type of each, and its channels.

Source: the field table of the RTDE guide. The emulator serves a field without channels, but the driver does not offer
it, because its unit depends on the controller's set-up, is not documented, or has no name here.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass

from cellwatt.channel import Channel, Kind
from cellwatt_drivers.ur.wire import ELEMENTS, ControllerVersion

JOINTS = 6

Since = tuple[tuple[int, int, int], ...]
"""First version that has a field, for each PolyScope generation; a generation not listed never has it."""

EVER: Since = ((3, 0, 0), (5, 0, 0), (10, 0, 0))


@dataclass(frozen=True, slots=True)
class Field:
    """One output field: element × ``scale`` is the value of the channel in the channel's unit."""

    name: str
    type: str
    channels: tuple[Channel, ...] = ()
    scale: float = 1.0
    since: Since = EVER

    @property
    def width(self) -> int:
        """Number of elements."""
        return ELEMENTS[self.type][1]

    def served_by(self, version: ControllerVersion) -> bool:
        """True if a controller of this version has the field."""
        now = (version.major, version.minor, version.bugfix)
        return any(version.major == first[0] and now >= first for first in self.since)

    @property
    def needs(self) -> str:
        """First versions that have the field, in words."""
        return " or ".join(".".join(map(str, first)) for first in self.since)


def _joints(name: str, quantity: str, unit: str, since: Since = EVER) -> Field:
    channels = tuple(Channel(f"joint_{i}.{quantity}", unit) for i in range(1, JOINTS + 1))
    return Field(name, "VECTOR6D", channels, since=since)


def _one(name: str, channel: str, unit: str, type: str = "DOUBLE", scale: float = 1.0, since: Since = EVER) -> Field:
    return Field(name, type, (Channel(channel, unit),), scale, since)


def _state(name: str, channel: str, type: str, since: Since = EVER) -> Field:
    return Field(name, type, (Channel(channel, "1", "discrete"),), since=since)


def _axes(name: str, *triples: tuple[str, str], since: Since = EVER) -> Field:
    # At half a turn a rotation vector flips its sign: what lies between two such is another orientation.
    channels = tuple(
        Channel(f"{stem}{axis}", unit, align="hold" if unit == "rad" else None)
        for stem, unit in triples
        for axis in "xyz"
    )
    return Field(name, "VECTOR6D" if len(triples) == 2 else "VECTOR3D", channels, since=since)


def _plain(type: str, names: Iterable[str], since: Since = EVER) -> Iterator[Field]:
    for name in names:
        yield Field(name, type, since=since)


def _registers(name: str, stem: str, type: str, numbers: range, kind: Kind) -> Iterator[Field]:
    for i in numbers:
        yield Field(f"{name}{i}", type, (Channel(f"register.{stem}_{i}", "1", kind),))


_PAYLOAD: Since = ((3, 11, 0), (5, 5, 1), (10, 0, 0))

FIELDS: Mapping[str, Field] = {
    f.name: f
    for f in (
        Field("timestamp", "DOUBLE"),
        _joints("target_q", "target_position", "rad"),
        _joints("target_qd", "target_velocity", "rad/s"),
        _joints("target_qdd", "target_acceleration", "rad/s^2"),
        _joints("target_current", "target_current", "A"),
        _joints("target_moment", "target_torque", "Nm"),
        _joints("actual_q", "position", "rad"),
        _joints("actual_qd", "velocity", "rad/s"),
        _joints("actual_current", "current", "A"),
        _joints("actual_current_window", "current_window", "A"),
        _joints("actual_current_as_torque", "torque", "Nm", ((5, 23, 0), (10, 11, 0))),
        _joints("joint_control_output", "control_current", "A"),
        _joints("joint_temperatures", "temperature", "degC"),
        _joints("actual_joint_voltage", "voltage", "V"),
        Field(
            "joint_mode",
            "VECTOR6INT32",
            tuple(Channel(f"joint_{i}.mode", "1", "discrete") for i in range(1, JOINTS + 1)),
        ),
        _one("actual_robot_voltage", "bus.voltage", "V"),
        _one("actual_robot_current", "bus.current", "A"),
        _one("actual_main_voltage", "main.voltage", "V"),
        _one("io_current", "io.current", "A", scale=1e-3),
        _axes("actual_TCP_pose", ("tool.", "m"), ("tool.r", "rad")),
        _axes("actual_TCP_speed", ("tool.velocity_", "m/s"), ("tool.velocity_r", "rad/s")),
        _axes("actual_TCP_force", ("tool.force_", "N"), ("tool.torque_", "Nm")),
        _axes("target_TCP_pose", ("tool.target_", "m"), ("tool.target_r", "rad")),
        _axes("target_TCP_speed", ("tool.target_velocity_", "m/s"), ("tool.target_velocity_r", "rad/s")),
        _axes("ft_raw_wrench", ("tool.raw_force_", "N"), ("tool.raw_torque_", "Nm"), since=((5, 9, 0), (10, 0, 0))),
        _axes("actual_tool_accelerometer", ("tool.acceleration_", "m/s^2")),
        _axes("elbow_position", ("elbow.", "m")),
        _axes("elbow_velocity", ("elbow.velocity_", "m/s")),
        _one("tcp_force_scalar", "tool.force", "N"),
        _one("tool_temperature", "tool.temperature", "degC"),
        _one("tool_output_current", "tool.output_current", "A", scale=1e-3),
        _one("tool_output_voltage", "tool.output_voltage", "V", type="INT32"),
        _one("payload", "payload.mass", "kg", since=_PAYLOAD),
        _axes("payload_cog", ("payload.", "m"), since=_PAYLOAD),
        _one("speed_scaling", "robot.speed_scaling", "1"),
        _one("target_speed_fraction", "robot.speed_fraction", "1"),
        _one("joint_position_deviation_ratio", "robot.position_deviation", "1"),
        _one("collision_detection_ratio", "robot.collision_ratio", "1"),
        _state("robot_mode", "robot.mode", "INT32"),
        _state("safety_mode", "robot.safety_mode", "INT32"),
        _state("safety_status", "robot.safety_status", "INT32"),
        _state("runtime_state", "robot.runtime_state", "UINT32"),
        _state("robot_status_bits", "robot.status_bits", "UINT32"),
        _state("safety_status_bits", "robot.safety_status_bits", "UINT32"),
        _state("script_control_line", "robot.script_line", "UINT32", ((3, 14, 0), (5, 9, 0), (10, 0, 0))),
        _state("actual_digital_input_bits", "digital.inputs", "UINT64"),
        _state("actual_digital_output_bits", "digital.outputs", "UINT64"),
        _state("tool_mode", "tool.mode", "UINT32"),
        _state("tool_output_mode", "tool.output_mode", "UINT8"),
        *_plain("UINT8", ("tool_digital_output0_mode", "tool_digital_output1_mode")),
        *_plain("UINT32", ("tool_analog_input_types",)),
        *_plain("DOUBLE", ("actual_momentum", "actual_execution_time")),
        *_plain("DOUBLE", ("tool_analog_input0", "tool_analog_input1")),
        *_plain("DOUBLE", (f"standard_analog_{way}{i}" for way in ("input", "output") for i in (0, 1))),
        *_plain("VECTOR6D", ("payload_inertia",), ((3, 15, 0), (5, 11, 0), (10, 0, 0))),
        *_registers("output_bit_register_", "bit", "BOOL", range(64, 128), "discrete"),
        *_registers("output_int_register_", "int", "INT32", range(48), "discrete"),
        *_registers("output_double_register_", "double", "DOUBLE", range(48), "continuous"),
    )
}
"""Every output field by its RTDE name."""


ROBOT_MODES: Mapping[int, str] = {
    -1: "no controller",
    0: "disconnected",
    1: "confirm safety",
    2: "booting",
    3: "power off",
    4: "power on",
    5: "idle",
    6: "backdrive",
    7: "running",
    8: "updating firmware",
}
SAFETY_MODES: Mapping[int, str] = {
    1: "normal",
    2: "reduced",
    3: "protective stop",
    4: "recovery",
    5: "safeguard stop",
    6: "system emergency stop",
    7: "robot emergency stop",
    8: "violation",
    9: "fault",
    10: "validate joint id",
    11: "undefined",
}
RUNTIME_STATES: Mapping[int, str] = {
    0: "stopping",
    1: "stopped",
    2: "playing",
    3: "pausing",
    4: "paused",
    5: "resuming",
}


def cycle_rate(version: ControllerVersion) -> float:
    """Rate of the controller's own loop, Hz: 125 for CB3, 500 for everything newer."""
    return 125.0 if version.major == 3 else 500.0


def decimation(loop: float, rate: float) -> int:
    """Number of cycles of the loop (Hz) per package, for a client that requests ``rate`` (Hz)."""
    return max(1, int(loop / rate + 1e-9))
