"""The robot's side of FCI, version 10: messages ⇄ bytes, for the emulator; pure functions.

Source: libfranka-common's ``rbk_types.h`` and ``service_types.h``; checked against pylibfranka 0.21.3. All numbers are
little-endian, without padding.
"""

from __future__ import annotations

import struct

import numpy as np

VERSION = 10
PORT = 1337
CONNECT, GET_ROBOT_MODEL = 0, 11
SUCCESS, INCOMPATIBLE = 0, 1

HEAD = struct.Struct("<III")
"""Command, number, size of the whole message."""

_FLOATS = (
    ("O_T_EE", 16), ("O_T_EE_d", 16), ("F_T_EE", 16), ("EE_T_K", 16), ("F_T_NE", 16), ("NE_T_EE", 16), ("m_ee", 1),
    ("I_ee", 9), ("F_x_Cee", 3), ("m_load", 1), ("I_load", 9), ("F_x_Cload", 3), ("elbow", 2), ("elbow_d", 2),
    ("tau_J", 7), ("tau_J_d", 7), ("dtau_J", 7), ("q", 7), ("q_d", 7), ("dq", 7), ("dq_d", 7), ("ddq_d", 7),
    ("joint_contact", 7), ("cartesian_contact", 6), ("joint_collision", 7), ("cartesian_collision", 6),
    ("tau_ext_hat_filtered", 7), ("O_F_ext_hat_K", 6), ("K_F_ext_hat_K", 6), ("O_dP_EE_d", 6), ("O_ddP_O", 3),
    ("elbow_c", 2), ("delbow_c", 2), ("ddelbow_c", 2), ("O_T_EE_c", 16), ("O_dP_EE_c", 6), ("O_ddP_EE_c", 6),
    ("theta", 7), ("dtheta", 7), ("accelerometer_top", 18), ("accelerometer_bottom", 18),
)  # fmt: skip

STATE = np.dtype(
    [("message_id", "<u8")]
    + [(name, "<f4", (count,)) for name, count in _FLOATS]
    + [("motion_generator_mode", "u1"), ("controller_mode", "u1"), ("errors", "u1", (41,))]
    + [("reflex_reason", "u1", (41,)), ("robot_mode", "u1"), ("control_command_success_rate", "<f4")]
)
"""One datagram, 1377 bytes."""


def decode_connect(payload: bytes) -> tuple[int, int]:
    """Version and UDP port of a connecting client; raises ``struct.error`` if the payload is too short."""
    version, port = struct.unpack_from("<HH", payload)
    return version, port


def connect_reply(number: int, status: int) -> bytes:
    """Answer to a connect."""
    return HEAD.pack(CONNECT, number, HEAD.size + 3) + struct.pack("<BH", status, VERSION)


def reply(command: int, number: int, status: int, payload: bytes = b"") -> bytes:
    """Answer to any other command."""
    return HEAD.pack(command, number, HEAD.size + 1 + len(payload)) + bytes([status]) + payload


def model(names: str = "fr3") -> bytes:
    """A robot description with the joint limits that the client's library requires."""
    joints = "".join(
        f'<joint name="{names}_joint{i}" type="revolute"><parent link="{names}_link{i - 1}"/>'
        f'<child link="{names}_link{i}"/><axis xyz="0 0 1"/>'
        '<limit lower="-2.9" upper="2.9" velocity="2.62" effort="87"/>'
        '<position_based_velocity_limits velocity_offset="0.3" deceleration_limit="6.0"/></joint>'
        for i in range(1, 8)
    )
    links = "".join(f'<link name="{names}_link{i}"/>' for i in range(8))
    return f'<?xml version="1.0"?><robot name="{names}">{links}{joints}</robot>'.encode()
