from __future__ import annotations

import math
import struct

import numpy as np
import pytest

from cellwatt.errors import ProtocolError
from cellwatt_drivers.abb import wire

MINIMAL = bytes.fromhex(
    "0a06080110041802 12140a12 090000000000002440 090000000000003440 22020801 2a020802 42020802".replace(" ", "")
)
FULL = bytes.fromhex(
    "0a07080710d20918021288010a36090000000000000000090000000000803ec0090000000000002e400900000000000000000900"
    "00000000004e40090000000000000000"
    "12430a1b090000000000407f40110000000000000000190000000000648940122409000000000000000011000000000000000019"
    "000000000000f03f210000000000000000"
    "22090880e2cfaa0610a01f"
    "1a380a36090000000000000000096666666666663ec0090000000000002e40090000000000000000090000000000004e40090000"
    "000000000000220208012a0208033000420208025100000000000029405803"
)
FORCE_7 = bytes.fromhex("4a0b080111000000000000f83f72090900000000000000 40".replace(" ", ""))
FORCE_6 = bytes.fromhex("4a0909000000000000f83f")
CORRECTION = bytes.fromhex("0a060801100a1803121 40a12090000000000000000090000000000000000".replace(" ", ""))

ALL = ("joints", "planned", "tool", "state", "force", "torque", "collision")


def read(datagram, groups=ALL, axes=6, external=()):
    columns = wire.columns(groups, axes, external)
    values = columns.row(wire.decode(datagram).message)
    assert len(values) == len(columns.channels)
    return dict(zip((c.name for c in columns.channels), values, strict=True))


def test_the_smallest_packet():
    packet = wire.decode(MINIMAL)
    assert (packet.sequence, packet.sent, packet.clock) == (1, 4, None)
    values = read(MINIMAL, ("joints", "state"), axes=2)
    assert values["joint_1.position"] == pytest.approx(math.radians(10))
    assert values["joint_2.position"] == pytest.approx(math.radians(20))
    assert (values["robot.motors_on"], values["robot.program_running"], values["robot.egm_state"]) == (1, 1, 2)
    assert math.isnan(values["robot.move_index"])


def test_a_full_packet_of_robotware_7():
    packet = wire.decode(FULL)
    assert (packet.sequence, packet.sent, packet.clock) == (7, 1234, 1_700_000_000_004_000_000)
    values = read(FULL)
    joints = [math.degrees(values[f"joint_{i}.position"]) for i in range(1, 7)]
    planned = [math.degrees(values[f"joint_{i}.target_position"]) for i in range(1, 7)]
    np.testing.assert_allclose(joints, [0, -30.5, 15, 0, 60, 0])
    np.testing.assert_allclose(planned, [0, -30.4, 15, 0, 60, 0])
    assert [values[f"tool.{a}"] for a in "xyz"] == pytest.approx([0.5, 0, 0.8125])
    assert [values[f"tool.q{a}"] for a in "wxyz"] == [0, 0, 1, 0]
    assert values["robot.egm_state"] == 3
    assert values["robot.move_index"] == 3
    assert all(math.isnan(values[k]) for k in ("tool.force_x", "joint_1.target_torque", "robot.collision"))


def test_force_is_told_apart_by_its_wire_type():
    seven, six = read(MINIMAL + FORCE_7), read(MINIMAL + FORCE_6)
    assert seven["tool.force_x"] == six["tool.force_x"] == 1.5
    assert seven["joint_1.target_torque"] == 2.0
    assert math.isnan(seven["tool.torque_z"])


def test_external_axes_turn_or_slide():
    external = b"\x12\x14\x1a\x12" + MINIMAL[12:30]
    values = read(MINIMAL + external, ("joints",), 2, ("rotary", "linear"))
    assert values["external_1.position"] == pytest.approx(math.radians(10))
    assert values["external_2.position"] == pytest.approx(0.020)


def test_a_linear_joint_of_the_robot_is_sent_like_an_angle_and_given_in_m():
    ways = [0.4, -0.09]  # m, as a SCARA's controller sends them: in degrees
    sent = b"".join(b"\x09" + struct.pack("<d", math.degrees(way)) for way in ways)
    datagram = MINIMAL[:8] + b"\x12" + bytes([len(sent) + 2]) + b"\x0a" + bytes([len(sent)]) + sent
    columns = wire.columns(("joints", "planned", "torque"), 2, (), linear=(2,))
    assert {channel.name: channel.unit for channel in columns.channels} == {
        "joint_1.position": "rad",
        "joint_2.position": "m",
        "joint_1.target_position": "rad",
        "joint_2.target_position": "m",
        "joint_1.target_torque": "Nm",
        "joint_2.target_torque": "N",
    }
    assert columns.row(wire.decode(datagram).message)[:2] == pytest.approx(ways)


def test_what_no_robot_sends_is_refused():
    with pytest.raises(ProtocolError, match="not of the type DATA"):
        wire.decode(CORRECTION)
    for broken in (b"", b"\x07", FULL[:-3], MINIMAL[:5]):
        with pytest.raises(ProtocolError):
            wire.decode(broken)
