from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt_drivers.kinova import registers
from cellwatt_drivers.kinova.registers import Turns

# Answers to reads of the arm's current and voltage, behind their head of transaction, length and unit.
CURRENT = bytes.fromhex("04 04 0000 3fa0")
VOLTAGE = bytes.fromhex("04 04 0000 41c0")


def words(answer: bytes) -> list[int]:
    return np.frombuffer(answer[2:], dtype=">u2").tolist()


def test_the_low_word_comes_first():
    block = [0x80, 0, 1, 0x80, 4, 0, *words(CURRENT), *words(VOLTAGE), *registers.encode([45.0, 38.5])]
    found = dict(zip((c.name for c in registers.ARM_CHANNELS), registers.arm_values(block), strict=True))
    assert found == {
        "bus.voltage": 24.0,
        "bus.current": 1.25,
        "bus.power": 30.0,
        "controller.temperature": 45.0,
        "controller.ambient_temperature": 38.5,
        "robot.state": 7.0,
        "robot.fault_flags": float(0x800001),
        "robot.warning_flags": 4.0,
    }


def test_every_register_has_its_place():
    """Each pair of registers holds its own address: a value in the wrong column shows."""
    first, count = registers.JOINTS_AND_TOOL
    block = registers.encode([float(first + 2 * i) for i in range(count // 2)])
    read = registers.joints(40.0, 7, True)
    assert (read.first, read.count) == (34, 106)
    found = dict(zip(read.stream.names, registers.motion_values(block, 7), strict=True))
    for joint in range(1, 8):
        assert math.degrees(found[f"joint_{joint}.position"]) == pytest.approx(34 + 2 * (joint - 1))
        assert math.degrees(found[f"joint_{joint}.velocity"]) == pytest.approx(48 + 2 * (joint - 1))
        assert found[f"joint_{joint}.torque"] == 62 + 2 * (joint - 1)
        assert found[f"joint_{joint}.current"] == 76 + 2 * (joint - 1)
        assert found[f"joint_{joint}.temperature"] == 90 + 2 * (joint - 1)
    assert [found[f"tool.{a}"] for a in "xyz"] == [104, 106, 108]
    assert [math.degrees(found[f"tool.r{a}"]) for a in "xyz"] == pytest.approx([110, 112, 114])
    assert [found[f"tool.velocity_{a}"] for a in "xyz"] == [116, 118, 120]
    assert [found[f"tool.force_{a}"] for a in "xyz"] == [128, 130, 132]
    assert [found[f"tool.torque_{a}"] for a in "xyz"] == [134, 136, 138]


def test_six_joints_are_the_first_six():
    block = registers.encode([float(34 + 2 * i) for i in range(35)])
    names = registers.joints(40.0, 6, False).stream.names
    found = dict(zip(names, registers.motion_values(block, 6), strict=True))
    assert len(found) == 30
    assert found["joint_6.torque"] == 72
    assert found["joint_1.current"] == 76


def test_a_state_is_one_bit():
    assert registers.state_of(1 << 7) == 7
    assert math.isnan(registers.state_of(0))
    assert math.isnan(registers.state_of(0b11))


@given(st.lists(st.floats(-3.0, 3.0), min_size=2, max_size=50))
def test_turns_are_followed(steps):
    """An angle that goes its way in steps of less than half a turn is found again but for whole turns."""
    truth = np.cumsum(steps)
    turns = Turns()
    found = np.array([turns.unwrap(np.array([angle % (2 * math.pi)]))[0] for angle in truth])
    assert abs(found[0]) <= math.pi + 1e-9
    np.testing.assert_allclose(np.diff(found), np.diff(truth), atol=1e-9)
    offset = (found - truth) / (2 * math.pi)
    np.testing.assert_allclose(offset, np.round(offset[0]), atol=1e-9)


def test_values_that_are_no_numbers_are_missing_and_the_next_are_good_again():
    turns = Turns()
    angles = ([3.0], registers.motion_values(registers.encode([math.inf] * 35), 7)[:1], [-3.0])
    found = [turns.unwrap(np.array(angle))[0] for angle in angles]
    assert math.isnan(found[1])
    assert found[2] == pytest.approx(2 * math.pi - 3.0)
