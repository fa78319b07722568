"""The RTDE codec: worked bytes, round trips, split streams and mutated frames."""

from __future__ import annotations

import random
import struct

import pytest
from hypothesis import given, settings
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


def test_questions_are_the_worked_bytes():
    assert wire.ASK_PROTOCOL.hex() == "0005560002"
    assert wire.ASK_CONTROLLER.hex() == "000376"
    assert wire.START.hex() == "000353"
    assert wire.PAUSE.hex() == "000350"
    assert wire.ask_outputs(500.0, NAMES).hex() == ASK_OUTPUTS


def test_answers_are_the_worked_bytes():
    assert wire.accept_reply(Kind.PROTOCOL_VERSION, True).hex() == "00045601"
    assert wire.accept_reply(Kind.START, True).hex() == "00045301"
    assert wire.controller_reply(ControllerVersion(5, 12, 0, 1101319)).hex() == VERSION
    assert wire.recipe_reply(Kind.SETUP_OUTPUTS, 1, ("DOUBLE", "VECTOR6D", "INT32")).hex() == TYPES
    assert wire.text_message(TextMessage("hello", "ctl", 2)).hex() == TEXT


def test_worked_bytes_are_read():
    assert wire.parse_controller(payload(VERSION)) == ControllerVersion(5, 12, 0, 1101319)
    assert str(wire.parse_controller(payload(VERSION))) == "5.12.0.1101319"
    assert wire.parse_recipe(payload(TYPES)) == (1, ("DOUBLE", "VECTOR6D", "INT32"))
    assert wire.parse_recipe(payload(NOT_FOUND)) == (1, ("DOUBLE", "NOT_FOUND"))
    assert wire.parse_ask_outputs(payload(ASK_OUTPUTS)) == (500.0, NAMES)
    assert wire.parse_text(payload(TEXT)) == TextMessage("hello", "ctl", 2)
    assert wire.parse_accept(b"\x01") and not wire.parse_accept(b"\x00")
    assert wire.parse_protocol(b"\x00\x02") == 2


def test_a_list_of_names_may_end_with_a_comma():
    assert wire.parse_ask_outputs(struct.pack(">d", 50.0) + b"timestamp,actual_q,")[1] == ("timestamp", "actual_q")


@pytest.mark.parametrize(
    ("parse", "data"),
    [
        (wire.parse_accept, b""),
        (wire.parse_accept, b"\x02"),
        (wire.parse_accept, b"\x01\x01"),
        (wire.parse_protocol, b"\x02"),
        (wire.parse_controller, bytes(15)),
        (wire.parse_recipe, b""),
        (wire.parse_recipe, b"\x01FLOAT"),
        (wire.parse_recipe, b"\x01DOUBLE,,DOUBLE"),
        (wire.parse_recipe, b"\x01DOUBL\xc9"),
        (wire.parse_ask_outputs, bytes(7)),
        (wire.parse_ask_outputs, struct.pack(">d", 0.0) + b"timestamp"),
        (wire.parse_ask_outputs, struct.pack(">d", float("nan")) + b"timestamp"),
        (wire.parse_text, b""),
        (wire.parse_text, b"\x05hell"),
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
    "controller": {"V": (4, 4), "v": (19, 19), "M": (6, 516), "O": (4, 16388), "I": (4, 16388), "S": (4, 4)},
    "client": {"V": (5, 5), "v": (3, 3), "M": (6, 516), "O": (11, 2059), "I": (3, 2051), "S": (3, 3), "P": (3, 3)},
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
    with pytest.raises(ValueError, match="at most"):
        wire.frame(Kind.TEXT_MESSAGE, bytes(0xFFFF))
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


text = st.text(st.characters(codec="utf-8"), max_size=60)
whole = st.integers(0, 2**32 - 1)
names = st.lists(st.from_regex(r"[a-zA-Z_0-9]{1,20}", fullmatch=True), max_size=40)


@given(text, text, st.integers(0, 255))
def test_text_messages_round_trip(message, source, level):
    sent = TextMessage(message, source, level)
    [(found, used)] = frames(data := wire.text_message(sent))
    assert used == len(data)
    assert wire.parse_text(found.payload) == sent


@given(st.builds(ControllerVersion, whole, whole, whole, whole))
def test_versions_round_trip(version):
    [(found, _)] = frames(wire.controller_reply(version))
    assert wire.parse_controller(found.payload) == version


@given(st.floats(0.001, 1e6), names.filter(bool))
def test_recipes_round_trip(rate, fields):
    [(found, _)] = frames(wire.ask_outputs(rate, fields), wire.FROM_CLIENT)
    assert wire.parse_ask_outputs(found.payload) == (rate, tuple(fields))


@given(st.integers(0, 255), st.lists(st.sampled_from([*wire.ELEMENTS, wire.NOT_FOUND]), min_size=1))
def test_recipe_replies_round_trip(recipe, types):
    [(found, _)] = frames(wire.recipe_reply(Kind.SETUP_OUTPUTS, recipe, types))
    assert wire.parse_recipe(found.payload) == (recipe, tuple(types))


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


PARSERS = {
    Kind.PROTOCOL_VERSION: wire.parse_accept,
    Kind.CONTROLLER_VERSION: wire.parse_controller,
    Kind.TEXT_MESSAGE: wire.parse_text,
    Kind.SETUP_OUTPUTS: wire.parse_recipe,
    Kind.START: wire.parse_accept,
    Kind.PAUSE: wire.parse_accept,
}


def check_stream(data: bytes) -> bool:
    """Scan a stream as the driver does; true where all of it was taken. Anything but ProtocolError fails."""
    package = Package(1, 64)
    position = 0
    try:
        for item, used in wire.scan(memoryview(data), wire.FROM_CONTROLLER, package):
            size = used - position
            if isinstance(item, Run):
                assert size == 64 * item.count == len(item.data)
                headers = {bytes(item.data[i : i + 4]) for i in range(0, size, 64)}
                assert headers == {bytes.fromhex("00405501")}
            else:
                shortest, longest = wire.FROM_CONTROLLER[item.kind]
                declared, kind = struct.unpack_from(">HB", data, position)
                assert shortest <= size == declared <= longest and kind == item.kind
                assert item.payload == data[position + 3 : used]
                PARSERS[item.kind](item.payload)
            assert position < used <= len(data)
            position = used
    except ProtocolError:
        return False
    return True


def mutate(data: bytes, chance: random.Random) -> bytes:
    out = bytearray(data)
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(out)) if out else 0
        match chance.randrange(5):
            case 0 if out:
                out[at] ^= 1 << chance.randrange(8)
            case 1 if out:
                out[at] = chance.randrange(256)
            case 2:
                del out[at : at + chance.randint(1, 9)]
            case 3:
                out[at:at] = chance.randbytes(chance.randint(1, 9))
            case 4:
                del out[at:]
    return bytes(out)


@pytest.mark.parametrize("count", [20_000, pytest.param(1_000_000, marks=[pytest.mark.slow, pytest.mark.timeout(900)])])
def test_mutated_frames_neither_crash_nor_pass_with_a_wrong_size(count):
    chance = random.Random(count)
    seeds = [bytes.fromhex(h) for h in (TYPES, NOT_FOUND, VERSION, TEXT, "00045601", "00045301", "00045001")]
    seeds += [bytes.fromhex(PACKAGE) * 3, bytes.fromhex(PACKAGE + TEXT + PACKAGE + VERSION + PACKAGE)]
    assert all(check_stream(s) for s in seeds)
    taken = sum(check_stream(mutate(chance.choice(seeds), chance)) for _ in range(count))
    assert 0 < taken < count


@settings(max_examples=300)
@given(st.binary(max_size=200))
def test_random_bytes_from_a_client_are_frames_or_refused(data):
    parsers = {Kind.PROTOCOL_VERSION: wire.parse_protocol, Kind.SETUP_OUTPUTS: wire.parse_ask_outputs}
    try:
        for item, _ in wire.scan(memoryview(data), wire.FROM_CLIENT):
            assert isinstance(item, Frame)
            parsers.get(item.kind, wire.parse_text)(item.payload)
    except ProtocolError as error:
        assert str(error)
