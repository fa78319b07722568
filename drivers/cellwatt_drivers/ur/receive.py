"""The ur-rtde library in a process of its own: ``python receive.py HOST RATE FIELD …`` (see ``shared.child``).

Its constructor holds the GIL and may block for ever, so it cannot live in the daemon. Writes each new state to
standard output as an RTDE data package whose fields all are doubles, timestamp first; ends with a line on
standard error when the library fails or the connection is gone.
"""

from __future__ import annotations

import struct
import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

from cellwatt_drivers.shared.child import take_stdout, write_all

RECIPE = 1

GETTERS: dict[str, str] = {
    "target_q": "getTargetQ",
    "target_qd": "getTargetQd",
    "target_qdd": "getTargetQdd",
    "target_current": "getTargetCurrent",
    "target_moment": "getTargetMoment",
    "actual_q": "getActualQ",
    "actual_qd": "getActualQd",
    "actual_current": "getActualCurrent",
    "joint_control_output": "getJointControlOutput",
    "joint_temperatures": "getJointTemperatures",
    "actual_joint_voltage": "getActualJointVoltage",
    "joint_mode": "getJointMode",
    "actual_robot_voltage": "getActualRobotVoltage",
    "actual_robot_current": "getActualRobotCurrent",
    "actual_main_voltage": "getActualMainVoltage",
    "actual_TCP_pose": "getActualTCPPose",
    "actual_TCP_speed": "getActualTCPSpeed",
    "actual_TCP_force": "getActualTCPForce",
    "target_TCP_pose": "getTargetTCPPose",
    "target_TCP_speed": "getTargetTCPSpeed",
    "ft_raw_wrench": "getFtRawWrench",
    "actual_tool_accelerometer": "getActualToolAccelerometer",
    "payload": "getPayload",
    "payload_cog": "getPayloadCog",
    "speed_scaling": "getSpeedScaling",
    "target_speed_fraction": "getTargetSpeedFraction",
    "robot_mode": "getRobotMode",
    "safety_mode": "getSafetyMode",
    "runtime_state": "getRuntimeState",
    "robot_status_bits": "getRobotStatus",
    "safety_status_bits": "getSafetyStatusBits",
    "actual_digital_input_bits": "getActualDigitalInputBits",
    "actual_digital_output_bits": "getActualDigitalOutputBits",
}
"""RTDE field → the library's method for it."""


def main(host: str, rate: float, fields: Sequence[str]) -> None:
    """Pass on every state that is newer than the one before, until the connection is gone."""
    from rtde_receive import RTDEReceiveInterface

    pipe = take_stdout()
    library = RTDEReceiveInterface(host, rate, ["timestamp", *fields])
    read = [getattr(library, GETTERS[f]) for f in fields]
    pause = 0.25 / rate
    last = None
    while True:
        now = library.getTimestamp()
        # The library takes a new state between any two calls: only what the same timestamp encloses is one.
        if now != last and library.getTimestamp() == now and (row := _row(read)) and library.getTimestamp() == now:
            last = now
            _write(pipe, now, row)
        elif not library.isConnected():
            raise ConnectionError("the controller closed the connection")
        else:
            time.sleep(pause)


def _row(read: Sequence[Callable[[], Any]]) -> list[float]:
    row: list[float] = []
    for get in read:
        value = get()
        row.extend(value if isinstance(value, list) else (value,))
    return row


def _write(pipe: int, now: float, row: list[float]) -> None:
    size = 4 + 8 * (1 + len(row))
    write_all(pipe, struct.pack(f">HBB{1 + len(row)}d", size, ord("U"), RECIPE, now, *row))


if __name__ == "__main__":
    try:
        main(sys.argv[1], float(sys.argv[2]), sys.argv[3:])
    except BrokenPipeError:
        sys.exit(0)
    except (RuntimeError, ConnectionError) as error:
        sys.exit(str(error))
