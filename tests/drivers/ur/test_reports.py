"""What people met with RTDE: issues and pull requests of Universal_Robots_Client_Library, by number."""

from __future__ import annotations

import asyncio
import struct
from contextlib import AbstractAsyncContextManager

import pytest

from cellwatt.account import Account
from cellwatt.emulation.relay import clients
from cellwatt_drivers.ur import wire
from cellwatt_drivers.ur.recipe import Selection
from cellwatt_drivers.ur.session import begin, connect
from cellwatt_drivers.ur.wire import Kind
from tests.patience import eventually

PACKAGE = struct.pack(">HBBdi", 16, ord("U"), 1, 1000.0, 7)


class Taken:
    """Takes packages."""

    def __init__(self) -> None:
        self.rows: list[tuple[float, list[float]]] = []

    def take(self, time, values, not_before=None, arrival=None) -> None:
        self.rows += zip(time.tolist(), values.tolist(), strict=True)


def controller(types: bytes, *answers: bytes) -> AbstractAsyncContextManager[tuple[str, object]]:
    """A controller that answers a start with ``answers``, each in a segment of its own; its address."""

    async def serve(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while True:
            size, kind = struct.unpack(">HB", await reader.readexactly(3))
            await reader.readexactly(size - 3)
            if kind == Kind.START:
                for answer in answers:
                    writer.write(answer)
                    await asyncio.sleep(0.01)
            elif kind != Kind.PAUSE:
                writer.write(wire.frame(Kind(kind), REPLIES[Kind(kind)] + types * (kind == Kind.SETUP_OUTPUTS)))

    return clients(serve)


REPLIES = {
    Kind.PROTOCOL_VERSION: wire.ACCEPTED,
    Kind.CONTROLLER_VERSION: struct.pack(">4I", 5, 25, 0, 0),
    Kind.SETUP_OUTPUTS: b"\x01",
}
CONFIRMED = wire.frame(Kind.START, wire.ACCEPTED)


async def packages(types: bytes, *answers: bytes, wanted: int) -> list[tuple[float, list[float]]]:
    """What a session gives of a controller's answers."""
    async with (
        controller(types, *answers) as (address, _),
        connect("127.0.0.1", int(address.rpartition(":")[2]), 5.0, lambda: 0, Account()) as (session, version),
    ):
        taken = Taken()
        await begin(session, version, Selection.of(["robot_mode"]), 500.0, taken.take, 5.0)
        await eventually(lambda: len(taken.rows) >= wanted)
        assert not session.closed.done()
    return taken.rows


@pytest.mark.parametrize("answers", [(CONFIRMED, PACKAGE), (PACKAGE, CONFIRMED, PACKAGE), (PACKAGE,)])
async def test_403_data_before_the_start_is_confirmed_or_without(answers):
    wanted = answers.count(PACKAGE)
    assert await packages(b"DOUBLE,INT32", *answers, wanted=wanted) == [(1000.0, [7.0])] * wanted


@pytest.mark.parametrize(("kind", "code"), [("UINT32", "I"), ("DOUBLE", "d"), ("UINT64", "Q")])
async def test_560_a_field_has_the_type_that_the_controller_declares(kind, code):
    package = wire.frame(wire.Kind.DATA_PACKAGE, struct.pack(f">Bd{code}", 1, 1000.0, 7))
    assert await packages(f"DOUBLE,{kind}".encode(), CONFIRMED, package, wanted=1) == [(1000.0, [7.0])]
