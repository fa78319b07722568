"""What one controller can send to keep the loop: every turn takes a little of it, and others have theirs in between."""

from __future__ import annotations

import asyncio
from typing import Any

import numpy as np
import pytest

from cellwatt import Identity, Stream
from cellwatt_drivers.ur import wire
from cellwatt_drivers.ur.intake import Intake
from cellwatt_drivers.ur.recipe import Decoder, Selection
from cellwatt_drivers.ur.session import AT_ONCE, BUFFER, Session
from cellwatt_drivers.ur.transport import GatheringTransport
from tests.patience import eventually

from ..inlet import CollectingInlet

SELECTION = Selection.of(["robot_mode"])
TYPES = ("DOUBLE", "INT32")


class Taps(GatheringTransport):
    """A transport that notes whether it may read."""

    def __init__(self) -> None:
        self.waited = 0
        self.reading = True
        self.closed = False

    def pause_reading(self) -> None:
        self.reading = False

    def resume_reading(self) -> None:
        self.reading = True

    def close(self) -> None:
        self.closed = True


def conversation() -> tuple[Session, Taps, CollectingInlet]:
    inlet = CollectingInlet()
    session = Session("192.0.2.10:30004", inlet.now, inlet.account)
    taps = Taps()
    session.connection_made(taps)
    session.decoder = Decoder(SELECTION, 1, TYPES)
    intake = Intake(inlet, Stream("rtde", SELECTION.channels, 500.0, "device"), "auto")
    intake.opened(Identity("Universal Robots", "e-Series"), 500.0, 500.0)
    session.take, session.say = intake.take, intake.message
    return session, taps, inlet


def feed(session: Session, data: bytes) -> None:
    """Read as the loop does: as much as there is room for."""
    room = session.get_buffer(-1)
    room[: len(data)] = data
    session.buffer_updated(len(data))


def package(time: float) -> bytes:
    body = b"\x01" + np.array([time], ">f8").tobytes() + np.array([7], ">i4").tobytes()
    return wire.frame(wire.Kind.DATA_PACKAGE, body)


MESSAGE = wire.text_message(wire.TextMessage("", "", 3))


async def turns(taken: Any, session: Session, taps: Taps) -> list[int]:
    """How much was taken in each turn of the loop, until all was."""
    found, before = [taken()], taken()
    while not taps.reading:
        await asyncio.sleep(0)
        found.append(taken() - before)
        before = taken()
    return found


@pytest.mark.parametrize("kind", ["messages", "packages", "both by turns", "a clock that runs backwards"])
async def test_a_turn_of_the_loop_takes_a_little_of_a_flood(kind: str) -> None:
    session, taps, inlet = conversation()
    data = {
        "messages": MESSAGE * 30_000,
        "packages": b"".join(package(10 + i / 500) for i in range(10_000)),
        "both by turns": b"".join(MESSAGE + package(10 + i / 500) for i in range(8_000)),
        "a clock that runs backwards": b"".join(package(100 - i / 500) for i in range(2_000)),
    }[kind]
    assert len(data) <= BUFFER

    def taken() -> int:
        return len(inlet.events) + sum(len(r.values) for r in inlet.readings)

    feed(session, data)
    found = await turns(taken, session, taps)
    assert max(found) <= AT_ONCE + 1, "one more event says that the stream is there, or keeps no grid"
    assert len(found) >= len(data) / BUFFER * 10
    assert taken() >= data.count(MESSAGE[2:]) + len(inlet.readings) > 0
    assert inlet.account.residue == 0
    if kind != "messages":
        sent = len([*wire.scan(memoryview(data), wire.FROM_CONTROLLER)])
        assert inlet.account.received == sent - len(inlet.texts("message"))


async def test_a_pause_after_the_age_of_bytes_was_read_sets_the_next_ones_arrival_not_back() -> None:
    session, taps, inlet = conversation()
    for number, taps.waited in enumerate((0, 1_000_000_000)):
        feed(session, package(10 + number / 500))
    first, second = inlet.readings
    assert second.arrival == first.arrival


async def test_bytes_that_are_no_frame_end_a_flood_in_the_middle() -> None:
    session, taps, inlet = conversation()
    feed(session, MESSAGE * 1000 + b"\x00\x02?")
    await eventually(lambda: taps.closed)
    assert len(inlet.events) == 1000 and inlet.account.counters["protocol error"] == 1
    assert session.closed.done()


async def test_a_message_of_another_form_breaks_nothing_where_nobody_listens() -> None:
    session, _, inlet = conversation()
    session.say = None
    feed(session, wire.frame(wire.Kind.TEXT_MESSAGE, b"\x02in the form of version 1"))
    assert not session.closed.done() and not inlet.account.anomalies
