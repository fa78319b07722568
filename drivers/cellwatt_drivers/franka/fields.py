"""Attributes of a robot's state, by the library's names, and their channels.

Source: libfranka's ``robot_state.h``. Poses are 4×4, in column-major order.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cellwatt.channel import Channel, Kind

JOINTS = 7
Group = Literal["joints", "targets", "motors", "external", "tool", "torque_rate", "state", "payload"]

MODES: Mapping[int, str] = {
    0: "other",
    1: "idle",
    2: "move",
    3: "guiding",
    4: "reflex",
    5: "user stopped",
    6: "automatic error recovery",
}
MODE = "robot.mode"


@dataclass(frozen=True, slots=True)
class Attribute:
    """One attribute of a state: its ``width``, and its channels as index → (name, unit, kind)."""

    name: str
    width: int
    channels: Mapping[int, tuple[str, str, Kind]]


def _joints(name: str, quantity: str, unit: str) -> Attribute:
    return Attribute(name, JOINTS, {i: (f"joint_{i + 1}.{quantity}", unit, "continuous") for i in range(JOINTS)})


def _one(name: str, channel: str, unit: str, kind: Kind = "continuous") -> Attribute:
    return Attribute(name, 1, {0: (channel, unit, kind)})


GROUPS: Mapping[Group, tuple[Attribute, ...]] = {
    "joints": (
        _joints("q", "position", "rad"),
        _joints("dq", "velocity", "rad/s"),
        _joints("tau_J", "torque", "Nm"),
    ),
    "targets": (
        _joints("q_d", "target_position", "rad"),
        _joints("dq_d", "target_velocity", "rad/s"),
        _joints("ddq_d", "target_acceleration", "rad/s^2"),
        _joints("tau_J_d", "target_torque", "Nm"),
    ),
    "motors": (
        _joints("theta", "motor_position", "rad"),
        _joints("dtheta", "motor_velocity", "rad/s"),
    ),
    "external": (_joints("tau_ext_hat_filtered", "external_torque", "Nm"),),
    "torque_rate": (_joints("dtau_J", "torque_rate", "Nm/s"),),
    "tool": (
        Attribute("O_T_EE", 16, {12 + i: (f"tool.{axis}", "m", "continuous") for i, axis in enumerate("xyz")}),
        Attribute(
            "O_F_ext_hat_K",
            6,
            {
                **{i: (f"tool.force_{axis}", "N", "continuous") for i, axis in enumerate("xyz")},
                **{3 + i: (f"tool.torque_{axis}", "Nm", "continuous") for i, axis in enumerate("xyz")},
            },
        ),
    ),
    "state": (
        _one("robot_mode", MODE, "1", "discrete"),
        _one("current_errors", "robot.error", "1", "discrete"),
        _one("control_command_success_rate", "robot.command_success_rate", "1", "discrete"),
    ),
    "payload": (_one("m_ee", "tool.mass", "kg", "discrete"), _one("m_load", "payload.mass", "kg", "discrete")),
}


@dataclass(frozen=True)
class Selection:
    """The attributes of some groups in order, their channels, and the channels' columns in a row of all values."""

    attributes: tuple[str, ...]
    channels: tuple[Channel, ...]
    columns: NDArray[np.intp]
    width: int

    @classmethod
    def of(cls, groups: Sequence[Group]) -> Selection:
        """The selection of these groups."""
        found = [attribute for group in groups for attribute in GROUPS[group]]
        starts = np.cumsum([0, *(a.width for a in found)])
        places = [
            (int(start) + place, Channel(*spec))
            for start, attribute in zip(starts, found, strict=False)
            for place, spec in attribute.channels.items()
        ]
        columns = np.array([place for place, _ in places], dtype=np.intp)
        return cls(tuple(a.name for a in found), tuple(c for _, c in places), columns, int(starts[-1]))
