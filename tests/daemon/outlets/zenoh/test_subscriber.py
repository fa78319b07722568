"""The public subscriber beside an outlet, over real sessions in one process."""

from __future__ import annotations

import asyncio
import itertools
import threading
import time
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from typing import Any

import numpy as np
import pytest

from cellwatt import Batch, ConfigError, OutletError
from cellwatt.errors import RepairingError
from cellwatt.outlets.zenoh import ZenohOutlet, ZenohSettings, publisher
from cellwatt.outlets.zenoh.encode import encode
from cellwatt.outlets.zenoh.link import open_session
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.subscriber import Gap, LinkSettings, Message, Subscriber
from cellwatt.subscriber.inbox import Mailbox
from tests.daemon.outlets.zenoh.fake_cell import CELL, EPOCH, SITE, FakeView, Journal, alarm, batch, task
from tests.daemon.outlets.zenoh.processes import free_port
from tests.daemon.outlets.zenoh.serving import serving
from tests.patience import PATIENCE, eventually

RAW = "raw/arm/samples"


class Cell:
    """An outlet at work, and the subscribers' way to it."""

    def __init__(self, **settings: Any) -> None:
        endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.view = FakeView()
        self.outlet = ZenohOutlet("zenoh", ZenohSettings(listen=(endpoint,), **settings), self.view)
        self.link = LinkSettings(mode="client", connect=(endpoint,))

    def subscriber(self, **more: object) -> Subscriber:
        return Subscriber(SITE, CELL, self.link, **more)  # type: ignore[arg-type]

    @asynccontextmanager
    async def joined(self, **more: object) -> AsyncIterator[Subscriber]:
        """A subscriber that knows where the cell is."""
        async with self.subscriber(**more) as subscriber:
            await eventually(lambda: subscriber._inbox.following.joined, "the subscriber to know where the cell is")
            yield subscriber

    def give(self, first: int, count: int, live: bool = True) -> None:
        item = batch(first, count)
        self.view.record(item)
        if live:
            self.outlet.offer(item)
        else:  # the outlet knows of it and loses it on the way
            self.outlet._ends[RAW] = (EPOCH, first + count)


@pytest.fixture
async def cell() -> AsyncIterator[Cell]:
    found = Cell()
    async with serving(found.outlet):
        yield found


async def read(subscriber: Subscriber, count: int, topic: str = "") -> list[Message]:
    """The next messages of a topic."""
    found: list[Message] = []
    async with asyncio.timeout(PATIENCE):
        async for message in subscriber:
            if message.topic.startswith(topic):
                found.append(message)
                if len(found) == count:
                    break
    return found


async def test_what_the_record_has_forgotten_is_a_gap(cell: Cell) -> None:
    async with cell.joined(want=("raw",)) as subscriber:
        cell.give(0, 100, live=False)
        cell.view.forgotten = 60
        cell.give(100, 5)
        gap, rest, live = await read(subscriber, 3)
        assert subscriber.counts["lost"] == 60
    assert isinstance(gap.content, Gap)
    assert (gap.sequence, gap.count) == (0, 60)
    assert (rest.sequence, rest.count, live.sequence) == (60, 40, 100)


async def test_what_is_being_repaired_is_asked_for_until_it_is_there(
    cell: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    history, asked = cell.view.history, itertools.count(1)

    def repairing(*question: Any) -> Sequence[Batch]:
        if next(asked) < 3:
            raise RepairingError("it is being repaired")
        return history(*question)

    monkeypatch.setattr(cell.view, "history", repairing)
    async with cell.joined(want=("raw",), patience=0.0) as subscriber:
        cell.give(0, 5)
        await read(subscriber, 1)
        cell.give(5, 20, live=False)
        (late,) = await read(subscriber, 1)
    assert (late.sequence, late.count, late.backfilled) == (5, 20, True)
    assert cell.outlet.account.counters["questions left open: a recording is being repaired"] == 2


async def test_resume_goes_on_where_an_earlier_run_stopped(cell: Cell) -> None:
    async with cell.joined(want=("raw", "alarm")) as subscriber:
        cell.give(0, 5)
        await read(subscriber, 1)
        positions = subscriber.positions
    assert positions[RAW] == (EPOCH, 5)
    cell.give(5, 20, live=False)
    cell.outlet.offer(alarm(1))
    async with cell.subscriber(want=("raw", "alarm"), resume=positions) as subscriber:
        messages = {m.topic: m for m in await read(subscriber, 2)}
    assert (messages[RAW].sequence, messages[RAW].count, messages[RAW].backfilled) == (5, 20, True)
    assert messages["alarm"].content == alarm(1)


@pytest.mark.parametrize("unanswered", ["late", "not at all"])
async def test_alarms_that_are_up_are_asked_for_until_the_cell_answers(
    cell: Cell, monkeypatch: pytest.MonkeyPatch, unanswered: str
) -> None:
    cell.outlet.offer(alarm(1))
    reply, asked = cell.outlet._answers._reply_alarms, itertools.count(1)

    def unsure(query: Any) -> None:
        if next(asked) > 1:
            reply(query)
        elif unanswered == "late":
            time.sleep(0.5)
        else:
            query.drop()  # as where too many questions wait

    monkeypatch.setattr(cell.outlet._answers, "_reply_alarms", unsure)
    monkeypatch.setattr("cellwatt.subscriber.subscriber._TIMEOUT", 0.2)
    async with cell.subscriber(want=("alarm",)) as subscriber:
        (message,) = await read(subscriber, 1)
    assert message.content == alarm(1) and next(asked) > 2


async def test_the_answer_that_no_alarm_is_up_is_asked_for_once(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    reply, asked = cell.outlet._answers._reply_alarms, list[Any]()
    monkeypatch.setattr(cell.outlet._answers, "_reply_alarms", lambda query: asked.append(query) or reply(query))
    monkeypatch.setattr("cellwatt.subscriber.subscriber._AGAIN", 0.0)
    async with cell.joined(want=("alarm", "health")) as subscriber:
        await eventually(lambda: asked, "the question")
        await read(subscriber, 5, "health")
    assert len(asked) == 1


async def test_threads_read_with_receive_and_for(cell: Cell) -> None:
    def consume() -> list[int]:
        with cell.subscriber(want=("raw",)) as subscriber:
            with pytest.raises(TimeoutError):
                subscriber.receive(0.01)
            ready.set()
            first = subscriber.receive(PATIENCE)
            found = [first.sequence]
            for message in subscriber:
                found.append(message.sequence)
                if message.sequence >= 20:
                    subscriber.close()
            with pytest.raises(OutletError, match="closed"):
                subscriber.receive()
            return found

    ready = threading.Event()
    reading = asyncio.create_task(asyncio.to_thread(consume))
    await asyncio.to_thread(ready.wait, 20)
    starts = itertools.count(0, 5)
    await eventually(lambda: cell.give(next(starts), 5) or reading.done(), "enough to read")
    found = await reading
    assert found == sorted(found)
    assert found[-1] >= 20


async def test_a_consumer_that_is_slow_gets_all_of_it(cell: Cell) -> None:
    async with cell.joined(want=("raw",), queue_size=2) as subscriber:
        for first in range(0, 5000, 5):
            cell.give(first, 5)
            if first % 500 == 0:
                await asyncio.sleep(0)
        following = 0
        async with asyncio.timeout(PATIENCE):
            async for message in subscriber:
                assert message.sequence == following
                following += message.count
                if following == 5000:
                    break


async def test_a_message_that_was_damaged_on_its_way_is_asked_for_again(cell: Cell) -> None:
    payload = encode(batch(0, 5))
    damaged = payload[:-40] + bytes(b ^ 0x5A for b in payload[-40:])
    with await asyncio.to_thread(open_session, cell.link) as between:
        async with cell.joined(want=("raw",)) as subscriber:
            between.put(
                f"cellwatt/{SITE}/{CELL}/raw/arm/samples", damaged, attachment=Mark(EPOCH, 0, 5, EPOCH).encode(payload)
            )
            await eventually(lambda: subscriber.counts.get("unreadable") == 1, "the damaged one")
            cell.give(0, 5, live=False)
            cell.give(5, 5)
            again, following = await read(subscriber, 2)
    assert (again.sequence, again.backfilled) == (0, True)
    assert (following.sequence, following.backfilled) == (5, False)
    np.testing.assert_array_equal(again.content.values, batch(0, 5).values)


def test_topics_that_no_cell_has_are_refused() -> None:
    named = ("raw/arm", "prediction", "alarms", "x/y", "alarm/error", "raw/arm/", "raw/arm/samples/q1")
    refused = ", ".join(named[2:])
    with pytest.raises(ConfigError, match=f"no cell publishes {refused}; topics are raw/SOURCE/STREAM, frame, "):
        Subscriber(SITE, CELL, LinkSettings(), want=named)


async def test_who_joins_after_a_restart_is_told_the_alarms_that_are_up_and_nothing_else_of_before() -> None:
    cell = Cell()
    cell.view.journal = Journal(alarm(1), alarm(2), alarm(2, active=False), task(0), task(1))  # type: ignore[assignment]
    cell.view.alarms.raise_(alarm(3))  # whose message the journal no longer has
    outlet = cell.outlet = ZenohOutlet("zenoh", cell.outlet.settings, cell.view)
    async with serving(outlet), cell.joined(want=("alarm", "task")) as subscriber:
        up = [message.content for message in await read(subscriber, 2)]
        assert sorted(up, key=str) == [alarm(1), alarm(3)]
        outlet.offer(task(2))
        (new,) = await read(subscriber, 1)
    assert (new.content, new.sequence, new.backfilled) == (task(2), 2, False)


async def test_an_outlet_with_other_settings_goes_on_from_the_positions_of_the_one_before() -> None:
    cell = Cell()
    cell.view.journal = Journal()  # type: ignore[assignment]
    cell.give(0, 5)
    outlet = ZenohOutlet("zenoh", cell.outlet.settings, cell.view)
    outlet.succeed(cell.outlet)
    async with serving(outlet), cell.joined(want=("raw",)) as subscriber:
        outlet.offer(batch(5, 5))
        (new,) = await read(subscriber, 1)
    assert (new.sequence, new.count, new.backfilled) == (5, 5, False)


async def test_opening_that_is_cancelled_leaves_nothing_behind() -> None:
    link = LinkSettings(mode="client", connect=(f"tcp/127.0.0.1:{free_port()}",))
    subscriber = Subscriber(SITE, CELL, link)
    began = time.monotonic()
    with pytest.raises(TimeoutError):
        async with asyncio.timeout(0.05):
            await subscriber.__aenter__()
    assert time.monotonic() - began < 9
    assert subscriber._session is None
    with pytest.raises(OutletError, match="closed"):
        subscriber.receive()


async def test_messages_before_their_schema_are_asked_for_once_it_came(
    cell: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(publisher, "SCHEMA_EVERY", 1e9)
    monkeypatch.setattr(publisher.Publisher, "tell_schemas", lambda _: None)
    async with cell.joined(want=("raw",), patience=PATIENCE) as subscriber:
        cell.give(0, 5)
        (first,) = await read(subscriber, 1)
        subscriber._inbox._schemas.clear()
        for n in (1, 2):
            cell.give(5 * n, 5)
            await eventually(lambda n=n: subscriber.counts.get("let go") == n, "a message that cannot be read yet")  # type: ignore[misc]
        monkeypatch.setattr(publisher, "SCHEMA_EVERY", 0.0)
        cell.give(15, 5)
        later = await read(subscriber, 2)
    told = [(m.sequence, m.count, m.backfilled) for m in (first, *later)]
    assert told == [(0, 5, False), (5, 10, True), (15, 5, False)]
    assert later[0].content.values.tolist() == batch(5, 10).values.tolist()  # type: ignore[union-attr]
    assert subscriber.counts["duplicates"] == 0


# what waits for the consumer ------------------------------------------------------------------------------


def test_an_error_comes_after_what_is_left() -> None:
    box, first = Mailbox(2), Message(RAW, EPOCH, 0, False, batch(0, 1))
    box.put(first)
    box.end(ValueError("broken"))
    box.end()
    assert box.take() is first
    with pytest.raises(ValueError, match="broken"):
        box.take()


async def test_a_cancelled_take_loses_nothing() -> None:
    box, first = Mailbox(10), Message(RAW, EPOCH, 0, False, batch(0, 1))
    waiting = asyncio.create_task(box.take_async())
    await asyncio.sleep(0)
    waiting.cancel()
    box.put(first)
    with pytest.raises(asyncio.CancelledError):
        await waiting
    assert await box.take_async() is first
