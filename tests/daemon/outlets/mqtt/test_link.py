"""One connection to a broker."""

from __future__ import annotations

import asyncio
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.reasoncodes import ReasonCode

from cellwatt import Account, Task
from cellwatt.errors import OutletError
from cellwatt.outlets.mqtt.link import Link, LostError, reason
from cellwatt.outlets.mqtt.message import Message, Subscription
from cellwatt.outlets.mqtt.outbox import Backfill
from cellwatt.outlets.mqtt.session import Parcel, Session
from cellwatt.outlets.past import RecordedSpan
from cellwatt.outlets.selection import Row
from tests.daemon.outlets.mqtt.cell import LAYOUT, ROOT, Cell, outlet_of
from tests.patience import eventually

NOWHERE = "mqtt://127.0.0.1:1"
MESSAGE = Message("a", b"b", 1, False)


@pytest.mark.parametrize(
    ("error", "encrypted", "told"),
    [
        (TimeoutError("timed out"), True, "no answer: is the host running?"),
        (TimeoutError("_ssl.c:985: The handshake operation timed out"), True, "TLS handshake: is this a port for TLS?"),
        (ConnectionResetError(104, "reset"), True, "Connection reset by peer; is this port for TLS?"),
        (ConnectionResetError(104, "reset"), False, "by peer; is this port for connections without TLS?"),
    ],
)
def test_why_there_is_no_connection_is_told_with_advice(error: OSError, encrypted: bool, told: str) -> None:
    assert reason(error, encrypted=encrypted).endswith(told)


@pytest.mark.parametrize(
    ("code", "told"),
    [(142, "session taken over; another client has the same client ID: set 'client'"), (139, "server shutting down")],
)
async def test_why_a_broker_ends_a_connection_is_told_with_advice(code: int, told: str) -> None:
    link = Link(outlet_of(Cell(), NOWHERE).settings, "c", MESSAGE, None, print, Account())
    reasoned = ReasonCode(PacketTypes.DISCONNECT, identifier=code)
    link._on_disconnect(SimpleNamespace(is_disconnect_packet_from_server=True), reasoned, None)
    with pytest.raises(LostError) as error:
        await anext(aiter(link.messages()))
    assert str(error.value) == f"{NOWHERE}: the connection was lost: the broker reports: {told}"


@pytest.mark.parametrize("needed", [True, False])
async def test_a_subscription_that_the_broker_forbids_is_an_error_if_it_is_needed(
    needed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    account = Account()
    link = Link(outlet_of(Cell(), NOWHERE).settings, "c", MESSAGE, None, print, account)
    monkeypatch.setattr(link._client, "subscribe", lambda *_, **__: (0, 7))
    asking = asyncio.create_task(link.subscribe(Subscription("a/#", 0, needed)))
    await eventually(lambda: 7 in link._answers, "the question")
    link._on_answer(7, [ReasonCode(PacketTypes.SUBACK, identifier=135)])
    if needed:
        with pytest.raises(OutletError, match="forbids the subscription to a/#"):
            await asking
    else:
        await asking
    assert account.counters["subscriptions refused"] == (not needed)


def test_a_broker_that_cuts_a_client_for_its_subscription_is_served_without_it() -> None:
    format_ = outlet_of(Cell(), NOWHERE)._made()
    asked = [len(format_.subscriptions()), len(format_.subscriptions())]  # the first connection breaks
    format_.birth(0)
    assert [*asked, len(format_.subscriptions())] == [2, 0, 2]


async def test_the_past_goes_in_parcels_of_few_messages(monkeypatch: pytest.MonkeyPatch) -> None:
    outlet = outlet_of(Cell(), NOWHERE, backfill="100 kHz")
    past = Backfill(outlet.settings, (Path("/nonexistent"), "c"), outlet._cursor, outlet._outbox, outlet.account)
    none = dict.fromkeys(LAYOUT.names, 0)
    rows, tasks = [Row(n, n, {}, none) for n in range(1, 39)], [Task("arm", "t", "ab", "v", 1.0, 0, 1, (1,), 4)] * 40
    part = RecordedSpan(38, rows, list(tasks), dict.fromkeys(none, "1"), whole=True)
    monkeypatch.setattr(past, "_read", lambda *_: asyncio.sleep(0, part))
    filling, sizes, got = asyncio.create_task(past._fill(0, 38)), list[tuple[int, int]](), list[Row]()
    while not filling.done():
        await asyncio.sleep(0)
        if past.piece is not None:
            (results, some, arrived), past.piece = past.piece, None
            sizes.append((len(results), len(some)))
            got += some
            arrived(False)
    assert sizes == [(16, 0), (16, 0), (8, 0), (0, 16), (0, 16), (0, 6)] and got == rows


async def test_nothing_of_a_batch_that_the_library_refuses_counts_as_arrived() -> None:
    outlet, told = outlet_of(Cell(), NOWHERE), list[str]()

    def publish(_: Message) -> Any:
        raise ValueError("Payload too large.")

    parts: Any = SimpleNamespace(publish=publish), outlet._made(), outlet._outbox, outlet._cursor
    session = Session(outlet.settings, parts, None, "c", outlet.account)
    with pytest.raises(ValueError, match="too large"):
        await session._deliver([Parcel([MESSAGE], lambda: told.append("arrived"), lambda: told.append("back"))])
    session.end()
    assert told == ["back"]


async def test_a_thread_that_ends_while_it_is_stopped_is_no_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    link, reset = Link(outlet_of(Cell(), NOWHERE).settings, "c", MESSAGE, None, print, Account()), list[bool]()

    def stop() -> None:
        raise AttributeError("'NoneType' object has no attribute 'join'")

    link._connecting = asyncio.ensure_future(asyncio.sleep(0))
    monkeypatch.setattr(link._client, "loop_stop", stop)
    monkeypatch.setattr(link._client, "_reset_sockets", lambda: reset.append(True))
    await link.abort()
    assert reset == [True]


async def test_received_messages_and_answers_beyond_their_limits_are_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cellwatt.outlets.mqtt.link.RECEIVED", 4)
    monkeypatch.setattr("cellwatt.outlets.mqtt.session.ANSWERS", 3)
    outlet = outlet_of(Cell(), NOWHERE)
    link = Link(outlet.settings, "c", MESSAGE, None, print, outlet.account)
    for number in range(6):  # alarms that the broker retains from an earlier daemon
        link._on_message(SimpleNamespace(topic=f"{ROOT}/alarm/error/k/{number}", payload=b"{}", retain=True))
    link._on_disconnect(SimpleNamespace(is_disconnect_packet_from_server=False), None, None)
    session = Session(
        outlet.settings, (link, outlet._made(), outlet._outbox, outlet._cursor), None, "c", outlet.account
    )
    with pytest.raises(LostError):
        await session._listen()
    assert [answer.topic.rpartition("/")[2] for answer in session._answers] == ["0", "1", "2"]
    assert outlet.account.counters == {"received messages dropped": 2, "answers dropped": 1}
