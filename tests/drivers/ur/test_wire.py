"""The RTDE codec: worked bytes, round trips, split streams and mutated frames."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt.errors import ProtocolError
from cellwatt_drivers.ur import wire
from cellwatt_drivers.ur.wire import ControllerVersion, Frame, Kind, Package, Run, TextMessage

# Captured from, or computed by hand for, a controller with PolyScope 5.12.0.1101319.
ASK_OUTPUTS = "00284f407f40000000000074696d657374616d702c61637475616c5f712c726f626f745f6d6f6465"
TYPES = "00194f01444f55424c452c564543544f5236442c494e543332"
NOT_FOUND = "00144f01444f55424c452c4e4f545f464f554e44"
VERSION = "001376000000050000000c000000000010ce07"
PACKAGE = (
    "0040550140" + "8f4004189374bc3fe0000000000000bff40000000000003ff8000000000000bfd0000000000000"
    "3ff921fb54442d18000000000000000000000007"
)
TEXT = "000e4d0568656c6c6f0363746c02"

NAMES = ("timestamp", "actual_q", "robot_mode")


def frames(data: bytes, limits=wire.FROM_CONTROLLER, package=None):
    return list(wire.scan(memoryview(data), limits, package))


def payload(text: str) -> bytes:
    return bytes.fromhex(text)[3:]


def test_worked_bytes_are_read():
    assert wire.parse_controller(payload(VERSION)) == ControllerVersion(5, 12, 0, 1101319)
    assert str(wire.parse_controller(payload(VERSION))) == "5.12.0.1101319"
    assert wire.parse_recipe(payload(TYPES)) == (1, ("DOUBLE", "VECTOR6D", "INT32"))
    assert wire.parse_recipe(payload(NOT_FOUND)) == (1, ("DOUBLE", "NOT_FOUND"))
    assert wire.parse_ask_outputs(payload(ASK_OUTPUTS)) == (500.0, NAMES)
    assert wire.parse_text(payload(TEXT)) == TextMessage("hello", "ctl", 2)
    assert wire.parse_accept(b"\x01") and not wire.parse_accept(b"\x00")


@pytest.mark.parametrize(
    ("parse", "data"),
    [
        (wire.parse_accept, b"\x02"),
        (wire.parse_recipe, b"\x01FLOAT"),
        (wire.parse_recipe, b"\x01DOUBLE,,DOUBLE"),
        (wire.parse_ask_outputs, struct.pack(">d", float("nan")) + b"timestamp"),
        (wire.parse_text, b"\x05hello\x03ctl"),
        (wire.parse_text, b"\x05hello\x03ctl\x02\x00"),
    ],
)
def test_wrong_payloads_are_refused(parse, data):
    with pytest.raises(ProtocolError):
        parse(data)


IMPOSSIBLE = (
    "000056 000256 000356 000556 ffff56 000053 000553 001276 001476 ffff4d "
    "00054d 00034f ffff4f 000355 004000 00407f 004041 485454 000000"
)


@pytest.mark.parametrize("header", list(IMPOSSIBLE.split()))
def test_impossible_headers_are_refused_before_the_rest_has_come(header):
    with pytest.raises(ProtocolError):
        frames(bytes.fromhex(header))


SIZES = {
    "controller": {"V": (4, 4), "v": (19, 19), "M": (6, 516), "O": (4, 16388), "S": (4, 4), "P": (4, 4)},
    "client": {"V": (5, 5), "v": (3, 3), "M": (6, 516), "O": (11, 2059), "S": (3, 3), "P": (3, 3)},
}
"""Smallest and largest frame of each kind: a head of 3 bytes and what RTDE has in it, texts of 255, lists of names."""


@pytest.mark.parametrize(("sender", "kind"), [(sender, kind) for sender, sizes in SIZES.items() for kind in sizes])
def test_frames_of_a_kind_are_as_long_as_they_may_be(sender, kind):
    limits = wire.FROM_CLIENT if sender == "client" else wire.FROM_CONTROLLER
    shortest, longest = SIZES[sender][kind]
    for size in {shortest, longest}:
        [(found, used)] = frames(struct.pack(">HB", size, ord(kind)) + bytes(size - 3), limits)
        assert (chr(found.kind), used) == (kind, size)
    for size in (shortest - 1, longest + 1):
        with pytest.raises(ProtocolError):
            frames(struct.pack(">HB", size, ord(kind)) + bytes(max(size - 3, 0)), limits)


def test_names_and_frames_have_their_limits():
    assert len(wire.ask_outputs(1.0, ["a" * wire.NAMES_LIMIT])) == 11 + wire.NAMES_LIMIT
    with pytest.raises(ValueError, match="2048"):
        wire.ask_outputs(1.0, ["a" * 2049])
    with pytest.raises(ValueError, match="255"):
        wire.text_message(TextMessage("x" * 256, "", 0))


def test_packages_come_in_runs_around_a_text_message():
    package = bytes.fromhex(PACKAGE)
    data = package * 3 + bytes.fromhex(TEXT) + package * 2 + package[:10]
    found = frames(data, package=Package(1, 64))
    assert [(type(item), used) for item, used in found] == [(Run, 192), (Frame, 206), (Run, 334)]
    assert [item.count for item, _ in found if isinstance(item, Run)] == [3, 2]
    assert bytes(found[0][0].data) == package * 3


def test_what_comes_before_garbage_is_delivered():
    package = bytes.fromhex(PACKAGE)
    seen = []
    with pytest.raises(ProtocolError, match="kind 0x7f"):
        for item, used in wire.scan(memoryview(package * 2 + b"\x00\x40\x7f"), wire.FROM_CONTROLLER, Package(1, 64)):
            seen.append((item.count, used))
    assert seen == [(2, 128)]


@pytest.mark.parametrize("change", [(1, 0x41), (1, 0x3F), (3, 2)])
def test_a_package_of_another_size_or_recipe_is_refused(change):
    package = bytearray.fromhex(PACKAGE)
    package[change[0]] = change[1]
    with pytest.raises(ProtocolError, match="recipe"):
        frames(bytes.fromhex(PACKAGE) + bytes(package), package=Package(1, 64))


@given(st.lists(st.sampled_from(["package", "text", "version", "start"]), max_size=12), st.data())
def test_a_stream_cut_anywhere_gives_the_same_frames(kinds, data):
    parts = {
        "package": bytes.fromhex(PACKAGE),
        "text": bytes.fromhex(TEXT),
        "version": bytes.fromhex(VERSION),
        "start": bytes.fromhex("00045301"),
    }
    stream = b"".join(parts[k] for k in kinds)
    cuts = sorted(data.draw(st.lists(st.integers(0, len(stream)), max_size=8)))
    got, rest = [], b""
    for start, end in zip([0, *cuts], [*cuts, len(stream)], strict=True):
        rest += stream[start:end]
        end = 0
        for item, used in wire.scan(memoryview(rest), wire.FROM_CONTROLLER, Package(1, 64)):
            if isinstance(item, Run):
                got += ["package"] * item.count
            else:
                got.append(
                    {Kind.TEXT_MESSAGE: "text", Kind.CONTROLLER_VERSION: "version", Kind.START: "start"}[item.kind]
                )
            end = used
        rest = rest[end:]
    assert got == kinds
    assert rest == b""
