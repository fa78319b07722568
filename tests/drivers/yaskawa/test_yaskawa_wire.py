from __future__ import annotations

import pytest

from cellwatt.errors import ProtocolError
from cellwatt_drivers.yaskawa import payload, wire

HEAD = "5945524320000000 03 01 00 {number} 00000000 3939393939393939"
ANSWER_HEAD = "59455243 2000 {size} 03 01 01 00 00000080 3939393939393939 8100000000000000"
STATUS_ANSWER = bytes.fromhex(ANSWER_HEAD.format(size="0800") + "cc000000 40000000")
POSITION_DATA = bytes.fromhex(
    "000000000000000000000000000000000000000066340000 3497ffff 3d050000 e8030000 30f8ffff 6e020000 00000000 00000000"
)
CARTESIAN_DATA = bytes.fromhex(
    "10000000 04000000 00000000 00000000 00000000"
    "40e20100 b03cffff 140a0c00 40771b00 6044f2ff 88130000 00000000 00000000"
)
TORQUE_DATA = bytes.fromhex("0c000000 d3ffffff 1e000000 fdffffff 07000000 ffffffff 00000000 00000000")
AXIS_NAMES_DATA = bytes.fromhex("53000000 4c000000 55000000 52000000 42000000 54000000 00000000 00000000")
UNDEFINED = bytes.fromhex("59455243 2000 0000 03 01 01 00 00000080 3939393939393939 81 1f 01 00 00a0 0000")


@pytest.mark.parametrize(
    ("request_", "tail"),
    [
        (wire.Request(wire.STATUS), "7200 0100 00 01 0000"),
        (wire.Request(wire.AXIS_NAMES), "7400 0100 00 01 0000"),
        (wire.Request(wire.POSITION), "7500 0100 00 01 0000"),
        (wire.Request(wire.POSITION, 101), "7500 6500 00 01 0000"),
        (wire.Request(wire.TORQUE), "7700 0100 00 01 0000"),
        (wire.Request(0x7A, 5, 1, 0x0E), "7a00 0500 01 0e 0000"),
    ],
)
def test_requests_as_worked_out_by_hand(request_, tail):
    datagram = bytes.fromhex(HEAD.format(number="00") + tail)
    assert wire.encode_request(request_, 0) == datagram
    assert wire.decode_request(datagram) == (request_, 0)


def test_status_answer():
    answer = wire.decode_answer(STATUS_ANSWER)
    assert (answer.number, answer.service, answer.status, answer.added) == (0, 0x81, 0, 0)
    status = payload.decode_status(answer.data)
    assert {name for name, is_set in status.items() if is_set} == {"automatic", "running", "play", "remote", "servo_on"}


@pytest.mark.parametrize(("word", "hold"), [("02", True), ("04", True), ("08", True), ("50", False)])
def test_any_hold_bit_is_a_hold(word, hold):
    assert payload.decode_status(bytes.fromhex(f"00000000 {word}000000"))["hold"] is hold


def test_cartesian_answer():
    position = payload.decode_position(CARTESIAN_DATA, payload.BASE)
    assert position[:6] == (123456, -50000, 789012, 1800000, -900000, 5000)


@pytest.mark.parametrize("n", [4, 7, 8])
def test_shorter_positions_and_torques_are_read_by_their_length(n):
    full = (13414, -26828, 1341, 1000, -2000, 622, 0, 0)
    assert payload.decode_position(POSITION_DATA[: 20 + 4 * n], payload.PULSE) == full[:n]
    assert payload.decode_axes(TORQUE_DATA[: 4 * n]) == (12, -45, 30, -3, 7, -1, 0, 0)[:n]


def test_axis_names():
    assert payload.decode_axis_names(AXIS_NAMES_DATA) == ("S", "L", "U", "R", "B", "T")
    assert payload.encode_axis_names(("S", "L", "U", "R", "B", "T")) == AXIS_NAMES_DATA


def test_refusal_is_told_in_words():
    answer = wire.decode_answer(UNDEFINED)
    assert answer.text == "general error (status 0x1F, added status 0xA000: command is not defined)"
    assert not answer.busy


@pytest.mark.parametrize("added", [0xD8F1, 0xD8FA, 0xE444, 0xFFF6])
def test_busy_family(added):
    assert wire.Answer(0, 0x81, 0x1F, added).busy
    assert not wire.Answer(0, 0x81, 0, added).busy


def test_added_status_size_without_a_status_is_no_failure():
    raw = bytearray(STATUS_ANSWER)
    raw[26] = 2
    answer = wire.decode_answer(bytes(raw))
    assert answer.status == 0
    assert payload.decode_status(answer.data)["servo_on"]


def test_alarm_name_in_shift_jis():
    name = bytes.fromhex("835383938376838a 8341")  # katakana
    data = bytes.fromhex("db100000 05000000 01000000") + b"2024/05/06 07:08" + name.ljust(32, b"\0")
    alarm = payload.decode_alarm(data)
    assert (alarm.code, alarm.data, alarm.kind) == (4315, 5, 1)
    assert alarm.time == "2024/05/06 07:08"
    assert alarm.name == name.decode("shift_jis")


def test_unreadable_alarm_names_do_not_hide_the_code():
    data = bytes.fromhex("db100000 00000000 00000000") + b"\xff" * 16 + b"\x81\xffSHOCK".ljust(32, b"\0")
    alarm = payload.decode_alarm(data)
    assert alarm.code == 4315
    assert "SHOCK" in alarm.name


def test_a_position_of_another_kind_is_refused():
    with pytest.raises(ProtocolError, match="data type 16; asked for 0"):
        payload.decode_position(CARTESIAN_DATA, payload.PULSE)


@pytest.mark.parametrize(
    ("decode", "good"),
    [
        (payload.decode_status, 8),
        (payload.decode_axis_names, 32),
        (payload.decode_alarm, 60),
        (payload.decode_system, 48),
    ],
)
def test_wrong_lengths_are_refused(decode, good):
    decode(bytes(good))
    for size in {0, good - 1, good + 1, 479}:
        with pytest.raises(ProtocolError, match=f"{size} bytes; expected {good}"):
            decode(bytes(size))


@pytest.mark.parametrize("size", [0, 20, 43, 60])
def test_wrong_position_lengths_are_refused(size):
    with pytest.raises(ProtocolError, match="expected 20, and 4 for each of up to 9 axes"):
        payload.decode_position(bytes(size), payload.PULSE)


@pytest.mark.parametrize(
    ("offset", "value", "why"),
    [
        (0, b"Y"[0] ^ 1, "starts with"),
        (4, 0x21, "states"),
        (6, 7, "states"),
        (9, 2, "division"),
        (10, 0, "acknowledge"),
        (24, 0x01, "not an answer"),
    ],
)
def test_each_header_field_that_tells_an_answer_is_checked(offset, value, why):
    raw = bytearray(STATUS_ANSWER)
    raw[offset] = value
    with pytest.raises(ProtocolError, match=why):
        wire.decode_answer(bytes(raw))
