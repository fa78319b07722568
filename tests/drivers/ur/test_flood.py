"""What one controller can send to keep the loop: every turn takes a little of it, and others have theirs in between."""

from __future__ import annotations

import asyncio
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from cellwatt import Identity, Stream
from cellwatt_drivers.ur import wire
from cellwatt_drivers.ur.intake import Intake
from cellwatt_drivers.ur.recipe import Decoder, Selection
from cellwatt_drivers.ur.session import AT_ONCE, BUFFER, Session
from tests.patience import eventually

from ..inlet import CollectingInlet

SELECTION = Selection.of(["robot_mode"])
TYPES = ("DOUBLE", "INT32")


class Tapped(Session):
    """A session that notes whether it may read."""

    def _pause(self) -> None:
        self.reading = False

    def _resume(self) -> None:
        self.reading = True


def conversation() -> tuple[Tapped, CollectingInlet]:
    inlet = CollectingInlet()
    session = Tapped(Mock(), "192.0.2.10:30004", inlet.now, inlet.account, lambda: 0.0)
    session.decoder = Decoder(SELECTION, 1, TYPES)
    intake = Intake(inlet, Stream("rtde", SELECTION.channels, 500.0, "device"))
    intake.opened(Identity("Universal Robots", "e-Series"), 500.0, 500.0)
    session.take, session.say = intake.take, intake.message
    return session, inlet


def feed(session: Session, data: bytes, waited: int = 0) -> None:
    """Read as from the socket: as much as there is room for, that has waited for some ns."""
    room = session._view[session._filled :]
    room[: len(data)] = data
    session._received(len(data), waited)


def package(time: float) -> bytes:
    body = b"\x01" + np.array([time], ">f8").tobytes() + np.array([7], ">i4").tobytes()
    return wire.frame(wire.Kind.DATA_PACKAGE, body)


MESSAGE = wire.text_message(wire.TextMessage("", "", 3))


async def turns(taken: Any, session: Tapped) -> list[int]:
    """How much was taken in each turn of the loop, until all was."""
    found, before = [taken()], taken()
    while not session.reading:
        await asyncio.sleep(0)
        found.append(taken() - before)
        before = taken()
    return found


@pytest.mark.parametrize("kind", ["messages", "packages", "both by turns", "a clock that runs backwards"])
async def test_a_turn_of_the_loop_takes_a_little_of_a_flood(kind: str) -> None:
    session, inlet = conversation()
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
    found = await turns(taken, session)
    assert max(found) <= AT_ONCE + 1, "one more event says that the stream is there, or keeps no grid"
    assert len(found) >= len(data) / BUFFER * 10
    assert taken() >= data.count(MESSAGE[2:]) + len(inlet.readings) > 0
    assert inlet.account.residue == 0
    if kind != "messages":
        sent = len([*wire.scan(memoryview(data), wire.FROM_CONTROLLER)])
        assert inlet.account.received == sent - len(inlet.texts("message"))


async def test_a_pause_after_the_age_of_bytes_was_read_sets_the_next_ones_arrival_not_back() -> None:
    session, inlet = conversation()
    for number, waited in enumerate((0, 1_000_000_000)):
        feed(session, package(10 + number / 500), waited)
    first, second = inlet.readings
    assert second.arrival == first.arrival


async def test_bytes_that_are_no_frame_end_a_flood_in_the_middle() -> None:
    session, inlet = conversation()
    feed(session, MESSAGE * 1000 + b"\x00\x02?")
    await eventually(session.closed.done)
    assert len(inlet.events) == 1000 and inlet.account.counters["protocol error"] == 1


async def test_a_message_of_another_form_breaks_nothing_where_nobody_listens() -> None:
    session, inlet = conversation()
    session.say = None
    feed(session, wire.frame(wire.Kind.TEXT_MESSAGE, b"\x02in the form of version 1"))
    assert not session.closed.done() and not inlet.account.anomalies
