"""A controller's RTDE stream, from its bytes to samples and events."""

from __future__ import annotations

import struct
from collections.abc import Iterable
from contextlib import suppress

from cellwatt.channel import Stream
from cellwatt.driver import Identity
from cellwatt.errors import ProtocolError
from cellwatt_drivers.ur import wire
from cellwatt_drivers.ur.fields import FIELDS
from cellwatt_drivers.ur.intake import Intake
from cellwatt_drivers.ur.recipe import Decoder, Selection
from fuzz.drivers.inlet import CheckingInlet
from fuzz.target import Target

SELECTION = Selection.of(["robot_mode", "payload", "bus.power"])
TYPES = [FIELDS[name].type for name in SELECTION.names]
RECIPE = 1


def run(data: bytes) -> None:
    """The first byte says into what pieces the stream comes and whether a recipe was agreed."""
    how, stream = data[:1], data[1:]
    with suppress(ProtocolError):
        for item, _ in wire.scan(memoryview(stream), wire.FROM_CLIENT):
            assert isinstance(item, wire.Frame)
            _request(item)
    inlet = CheckingInlet()
    intake = Intake(inlet, Stream("rtde", SELECTION.channels, 125.0, "device"))
    intake.opened(Identity("UR", "fuzzed"), 125.0, 125.0)
    types = ["DOUBLE"] * len(TYPES) if how and how[0] & 128 else TYPES  # of the same width, which a decoder takes
    decoder = Decoder(SELECTION, RECIPE, types) if how and how[0] & 1 else None
    step = 1 + (how[0] >> 1 & 63 if how else 0) * 8
    rest = b""
    with suppress(ProtocolError):
        for at in range(0, len(stream), step):
            rest += stream[at : at + step]
            rest = rest[_take(rest, decoder, intake) :]


def _take(data: bytes, decoder: Decoder | None, intake: Intake) -> int:
    used = 0
    package = decoder.package if decoder is not None else None
    for item, end in wire.scan(memoryview(data), wire.FROM_CONTROLLER, package):
        assert used < end <= len(data)
        used = end
        if isinstance(item, wire.Run):
            assert decoder is not None
            assert item.count * decoder.package.size == len(item.data)
            intake.take(*decoder.decode(item.data, item.count))
        else:
            _answer(item, intake)
    return used


def _answer(frame: wire.Frame, intake: Intake) -> None:
    kind, payload = frame.kind, frame.payload
    with suppress(ProtocolError):
        if kind == wire.Kind.CONTROLLER_VERSION:
            assert wire.controller_reply(wire.parse_controller(payload))[3:] == payload
        elif kind == wire.Kind.SETUP_OUTPUTS:
            recipe, types = wire.parse_recipe(payload)
            assert wire.parse_recipe(wire.recipe_reply(kind, recipe, types)[3:]) == (recipe, types)
            Decoder(SELECTION, recipe, types)
        elif kind == wire.Kind.TEXT_MESSAGE:
            intake.message(wire.parse_text(payload))
        elif kind != wire.Kind.DATA_PACKAGE:
            assert wire.accept_reply(kind, wire.parse_accept(payload))[3:] == payload


def _request(frame: wire.Frame) -> None:
    if frame.kind != wire.Kind.SETUP_OUTPUTS:
        return
    with suppress(ProtocolError):
        rate, names = wire.parse_ask_outputs(frame.payload)
        if all(names):
            assert wire.parse_ask_outputs(wire.ask_outputs(rate, names)[3:]) == (rate, names)


def seeds() -> Iterable[bytes]:
    """A session as a controller answers it, and as a client asks."""
    answers = [
        wire.accept_reply(wire.Kind.PROTOCOL_VERSION, True),
        wire.controller_reply(wire.ControllerVersion(5, 12, 0, 1)),
        wire.text_message(wire.TextMessage("protective stop", "safety", 2)),
        wire.recipe_reply(wire.Kind.SETUP_OUTPUTS, RECIPE, TYPES),
    ]
    yield b"\0" + b"".join(answers)
    yield b"\x08" + b"".join(answers)
    packages = b"".join(package(1000.0 + 0.008 * i, 7) for i in (0, 1, 2, 2, 5, 6))
    yield b"\x01" + packages
    doubles = struct.pack(f">HBB{len(TYPES)}d", 4 + 8 * len(TYPES), wire.Kind.DATA_PACKAGE, RECIPE, *range(len(TYPES)))
    yield b"\xff" + doubles * 2
    yield b"\x7f" + answers[2] + packages + package(3.0, 5) + answers[1]
    yield b"\0" + wire.ASK_PROTOCOL + wire.ASK_CONTROLLER + wire.ask_outputs(125.0, SELECTION.names)
    yield b"\0" + wire.START + wire.PAUSE


def package(time: float, mode: int) -> bytes:
    """One data package of the agreed recipe."""
    letters = {"DOUBLE": "d", "INT32": "i"}
    form = struct.Struct(">HBB" + "".join(letters[name] for name in TYPES))
    values = [mode if name == "INT32" else 1.5 for name in TYPES[1:]]
    return form.pack(form.size, wire.Kind.DATA_PACKAGE, RECIPE, time, *values)


TARGET = Target(run, seeds, 2048)
