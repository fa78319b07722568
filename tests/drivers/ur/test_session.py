"""One connection, fed bytes as a hostile controller would send them."""

from __future__ import annotations

import asyncio
import struct

from cellwatt import Account
from cellwatt_drivers.ur import wire
from cellwatt_drivers.ur.native import FLOODED, HEARD_MESSAGES, MOST_MESSAGES, Session
from cellwatt_drivers.ur.wire import Kind, TextMessage


class Listener:
    """An intake that only hears messages."""

    def __init__(self) -> None:
        self.heard: list[TextMessage] = []

    def message(self, message: TextMessage) -> None:
        self.heard.append(message)


def text(words: str) -> bytes:
    def short(part: str) -> bytes:
        return struct.pack("B", len(part)) + part.encode()

    return wire.frame(Kind.TEXT_MESSAGE, short(words) + short("PolyScope") + b"\x03")


def feed(session: Session, data: bytes) -> None:
    while data:
        room = session.get_buffer(-1)
        part, data = data[: len(room)], data[len(room) :]
        room[: len(part)] = part
        session.buffer_updated(len(part))


async def test_of_a_flood_of_messages_a_few_are_heard_and_the_rest_counted():
    account, listener = Account(), Listener()
    session = Session("192.0.2.1:30004", lambda: 0, account)
    session.intake = listener  # type: ignore[assignment]
    for _ in range(100):
        feed(session, 200 * text("alive"))
        await asyncio.sleep(0)
    assert HEARD_MESSAGES <= len(listener.heard) <= 20 * HEARD_MESSAGES
    assert len(listener.heard) + account.counters["messages left out"] == 20_000
    assert not session.closed.done()


async def test_more_messages_than_any_controller_sends_end_the_connection():
    session = Session("192.0.2.1:30004", lambda: 0, Account())
    session._second = asyncio.get_running_loop().time() + 3600  # the same second, however slow this machine is
    for _ in range(MOST_MESSAGES // 500 + 1):
        feed(session, 500 * text("x"))
        await asyncio.sleep(0)
    assert "no controller does that" in str(session.closed.exception())


async def test_in_a_flood_little_is_taken_in_one_turn_of_the_loop():
    session = Session("192.0.2.1:30004", lambda: 0, Account())
    session._second = asyncio.get_running_loop().time() + 3600
    feed(session, HEARD_MESSAGES * text("x"))
    before = len(session.get_buffer(-1))
    feed(session, text("x"))
    assert len(session.get_buffer(-1)) == FLOODED < before
