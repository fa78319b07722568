"""The outlet over real sessions: what a plain Zenoh consumer sees."""

from __future__ import annotations

import asyncio
import json
import zlib
from collections.abc import AsyncIterator
from contextlib import AsyncExitStack, asynccontextmanager
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pyarrow as pa
import pytest
import zenoh

from cellwatt import Event, Prediction, Stream
from cellwatt.errors import OutletError
from cellwatt.outlets.zenoh import ZenohOutlet, ZenohSettings, namesakes, publisher
from cellwatt.outlets.zenoh.encode import decode, schema_in
from cellwatt.outlets.zenoh.link import LinkSettings, open_session
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.publisher import Publisher
from tests.daemon.outlets.zenoh.fake_cell import EPOCH, STREAM, FakeView, alarm, batch, frames
from tests.daemon.outlets.zenoh.processes import free_port
from tests.daemon.outlets.zenoh.serving import opened
from tests.doing import doing
from tests.patience import eventually

ROOT = "cellwatt/plant-1/weld-3"


def mark_of(sample: Any) -> Mark:
    return Mark.decode(sample.attachment.to_bytes(), sample.payload.to_bytes())


class Consumer:
    """A plain session that keeps all it hears of the cell."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session
        self.samples: list[zenoh.Sample] = []
        session.declare_subscriber(f"{ROOT}/**", self.samples.append)

    def keys(self) -> list[str]:
        return [str(s.key_expr).removeprefix(f"{ROOT}/") for s in self.samples]

    async def until(self, count: int) -> list[zenoh.Sample]:
        await eventually(lambda: len(self.samples) >= count, f"{count} messages, heard {self.keys()}")
        return self.samples

    async def ask(self, path: str) -> list[zenoh.Reply]:
        return await asyncio.to_thread(lambda: list(self.session.get(f"{ROOT}/{path}", timeout=10.0)))

    async def ask_json(self, path: str) -> Any:
        (reply,) = await self.ask(path)
        return json.loads(reply.ok.payload.to_bytes())


@asynccontextmanager
async def client(endpoint: str) -> AsyncIterator[zenoh.Session]:
    with await asyncio.to_thread(open_session, LinkSettings(mode="client", connect=(endpoint,))) as session:
        yield session


@pytest.fixture
def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


@pytest.fixture
def view() -> FakeView:
    return FakeView()


@pytest.fixture
def outlet(endpoint: str, view: FakeView) -> ZenohOutlet:
    return ZenohOutlet("zenoh", ZenohSettings(listen=(endpoint,)), view)


@pytest.fixture
async def consumer(outlet: ZenohOutlet, endpoint: str) -> AsyncIterator[Consumer]:
    async with doing(outlet.run()), client(endpoint) as session:
        found = Consumer(session)
        await hears(found, outlet)
        yield found


async def hears(consumer: Consumer, outlet: ZenohOutlet) -> None:
    """Until the subscription has reached the outlet."""
    await eventually(lambda: outlet.health({}) or consumer.samples, "health")
    await asyncio.sleep(0.1)  # what health is still on its way
    consumer.samples.clear()


async def test_each_item_has_its_key_encoding_and_mark(consumer: Consumer, outlet: ZenohOutlet) -> None:
    outlet.offer(Prediction("power", 3, (5,), {"power": (1.0,)}, {"power": "W"}))
    await consumer.until(1)
    outlet.offer(alarm(1))
    outlet.offer(Event(EPOCH, "arm", "connected", "UR10e"))
    await consumer.until(3)
    outlet.offer(frames(8, 2))
    await consumer.until(4)
    outlet.offer(batch(20, 5))
    samples = await consumer.until(5)
    assert consumer.keys() == ["prediction/power", "alarm/error/joint_fault", "event", "frame", "raw/arm/samples"]
    assert [str(s.encoding) for s in samples] == ["application/json"] * 3 + ["application/vnd.apache.arrow.stream"] * 2
    marks = [mark_of(s) for s in samples]
    assert [(m.sequence, m.count, m.backfill) for m in marks] == [(0, 1, False)] * 3 + [(8, 2, False), (20, 5, False)]
    assert marks[4].session == EPOCH
    decoded = decode(samples[4].payload.to_bytes(), marks[4])
    assert decoded.values.tolist() == batch(20, 5).values.tolist()
    assert json.loads(samples[1].payload.to_bytes())["mark"] == {"session": marks[1].session, "sequence": 0}


async def test_a_late_comer_gets_the_active_alarms_and_not_the_cleared_ones(
    consumer: Consumer, outlet: ZenohOutlet
) -> None:
    for number in (1, 2, 3):
        outlet.offer(alarm(number))
    outlet.offer(alarm(2, active=False))
    await consumer.until(4)
    assert json.loads(consumer.samples[3].payload.to_bytes())["active"] is False
    # The default consolidation keeps one reply a key: two alarms of one kind must still both arrive.
    replies = await consumer.ask("alarm/**")
    assert sorted(json.loads(r.ok.payload.to_bytes())["id"] for r in replies) == ["alarm-1", "alarm-3"]
    assert all(mark_of(r.ok).backfill for r in replies)
    assert sorted(str(r.ok.key_expr) for r in replies)[0] == f"{ROOT}/alarm/error/joint_fault/alarm-1"
    assert await consumer.ask("alarm/warning/**") == []
    assert len(await consumer.ask("alarm/error/**")) == 2
    over = await consumer.ask("alarm/**?cleared=1")
    assert sorted(json.loads(r.ok.payload.to_bytes())["id"] for r in over) == ["alarm-1", "alarm-2", "alarm-3"]
    (one,) = await consumer.ask("alarm/error/joint_fault")
    assert str(one.ok.key_expr) == f"{ROOT}/alarm/error/joint_fault"


async def test_whoever_follows_one_severity_hears_of_a_change(consumer: Consumer, outlet: ZenohOutlet) -> None:
    outlet.offer(alarm(1, severity="error"))
    outlet.offer(alarm(1, severity="warning"))
    await consumer.until(3)
    assert sorted(consumer.keys()) == [f"alarm/{each}/joint_fault" for each in ("error", "error", "warning")]
    marks = {mark_of(s).sequence for s in consumer.samples}
    assert marks == {0, 1}


async def test_questions(consumer: Consumer, outlet: ZenohOutlet, view: FakeView) -> None:
    view.record(batch(0, 10))
    assert (await consumer.ask_json("@/config"))["password"] == "${SECRET}"
    assert await consumer.ask_json("@/schema") == view.schema()
    assert await consumer.ask_json("@/recordings") == view.recordings()
    assert (await consumer.ask_json("@/status"))["session"] == EPOCH
    everything = await consumer.ask("@/*")
    assert {str(r.ok.key_expr).rsplit("/", 1)[1] for r in everything} == {"status", "config", "schema", "recordings"}
    assert [str(r.ok.key_expr) for r in await consumer.ask("**")] == [], "questions are asked by name, never by **"


async def test_history_is_an_arrow_stream(consumer: Consumer, view: FakeView) -> None:
    view.record(batch(0, 10))
    (reply,) = await consumer.ask("@/history?source=arm;stream=samples;first=4;count=3")
    assert str(reply.ok.key_expr) == f"{ROOT}/@/history"
    assert mark_of(reply.ok) == Mark(EPOCH, 4, 3, EPOCH, backfill=True)
    table = pa.ipc.open_stream(reply.ok.payload.to_bytes()).read_all()
    assert [row[0] for row in table["values"].to_pylist()] == [4, 5, 6]


async def test_a_second_daemon_under_the_cells_name_is_reported_by_both(
    outlet: ZenohOutlet, endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(namesakes, "PATIENCE", 0.0)
    linked = ZenohSettings(mode="client", connect=(endpoint,))
    successor = ZenohOutlet("zenoh", linked, FakeView())  # the same daemon, after a reload
    second = ZenohOutlet("zenoh", linked, FakeView(EPOCH + 3_600_000_000_000))
    neighbour = ZenohOutlet("zenoh", linked, FakeView(EPOCH + 1, cell="weld-4"))
    async with doing(outlet.run()), doing(successor.run()), doing(neighbour.run()):
        await opened(neighbour)
        await opened(successor)
        assert outlet.trouble() is None
        async with doing(second.run()):
            await eventually(outlet.trouble, "the second daemon is noticed")
            await eventually(second.trouble, "and notices the first")
            assert "a second daemon publishes as plant-1/weld-3" in (outlet.trouble() or "")
            assert neighbour.trouble() is None
        await eventually(lambda: outlet.trouble() is None, "the end of the second daemon")


async def test_what_is_not_to_be_published_is_not(view: FakeView, endpoint: str) -> None:
    outlet = ZenohOutlet("zenoh", ZenohSettings(listen=(endpoint,), publish={"raw": False, "frames": False}), view)
    async with doing(outlet.run()), client(endpoint) as session:
        consumer = Consumer(session)
        await hears(consumer, outlet)
        outlet.offer(batch(0, 5))
        outlet.offer(frames(0, 5))
        outlet.offer(alarm(1))
        await consumer.until(1)
        assert consumer.keys() == ["alarm/error/joint_fault"]
    assert outlet.account.expected == 1


async def test_nothing_is_encoded_while_nobody_subscribes(
    outlet: ZenohOutlet, endpoint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    encoded: list[Any] = []
    real = publisher.encode_apart
    monkeypatch.setattr(publisher, "encode_apart", lambda block: encoded.append(block) or real(block))
    assert not outlet.awaited
    async with doing(outlet.run()):
        await opened(outlet)
        outlet.offer(batch(0, 5))
        outlet.offer(frames(0, 2))
        assert outlet.account.received == 7
        assert not outlet.awaited and not encoded
        async with client(endpoint) as session:
            consumer = Consumer(session)
            await eventually(lambda: outlet.awaited, "the subscriber")
            outlet.offer(batch(5, 3))
            await consumer.until(1)
            assert mark_of(consumer.samples[0]).sequence == 5
            assert len(encoded) == 1
        await eventually(lambda: not outlet.awaited, "the end of the subscriber")
    assert outlet.account.residue == 0


async def test_the_schema_goes_out_first_then_now_and_then_and_when_somebody_comes(
    consumer: Consumer, outlet: ZenohOutlet, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(publisher, "SCHEMA_EVERY", 1e9)
    slower = replace(STREAM, rate=100.0)

    async def offer(number: int, stream: Stream) -> None:
        outlet.offer(batch(5 * number, 5, stream=stream))
        await consumer.until(number + 1)

    await offer(0, STREAM)
    await offer(1, STREAM)
    await offer(2, slower)  # new settings
    await consumer.ask("@/status")  # as a consumer that comes does first
    await offer(3, slower)
    await offer(4, slower)
    monkeypatch.setattr(publisher, "SCHEMA_EVERY", 0.0)
    await offer(5, slower)
    heard = [(mark_of(s), s.payload.to_bytes()) for s in consumer.samples]
    assert [mark.schema == 0 for mark, _ in heard] == [True, False, True, True, False, True]
    known = {zlib.crc32(schema_in(payload)): schema_in(payload) for mark, payload in heard if not mark.schema}
    assert len(known) == 2
    for n, (mark, payload) in enumerate(heard):
        read = decode(known[mark.schema] + payload if mark.schema else payload, mark)
        assert read.values.tolist() == batch(5 * n, 5).values.tolist()


async def test_what_was_offered_before_a_stop_arrives(outlet: ZenohOutlet, endpoint: str) -> None:
    async with AsyncExitStack() as until_the_end:
        async with doing(outlet.run()):
            consumer = Consumer(await until_the_end.enter_async_context(client(endpoint)))
            await hears(consumer, outlet)
            for first in range(0, 3000, 3):
                outlet.offer(batch(first, 3))
        assert outlet.account.received == 3000
        assert outlet.account.residue == 0
        await eventually(lambda: consumer.samples and mark_of(consumer.samples[-1]).end == 3000, "the last sample")


async def test_without_a_router_nothing_waits_and_its_alarms_are_for_who_asks_later(
    endpoint: str, view: FakeView
) -> None:
    outlet = ZenohOutlet("zenoh", ZenohSettings(mode="client", connect=(endpoint,)), view)
    async with doing(outlet.run()) as task:
        outlet.offer(batch(0, 2))
        outlet.offer(alarm(1))
        outlet.health({})
        assert not task.done()
        assert outlet.account.counters == {"not published: no session": 3}
        assert outlet.account.residue == 0
        with await asyncio.to_thread(open_session, LinkSettings(mode="router", listen=(endpoint,))) as session:
            consumer = Consumer(session)
            await opened(outlet)
            # A session learns a moment after it was opened who answers it.
            replies = await eventually(lambda: consumer.ask("alarm/**"), "the alarm's answer")
            assert len(replies) == 1
            (told,) = await consumer.ask("@/status")
            assert json.loads(told.ok.payload.to_bytes())["positions"]["raw/arm/samples"] == [EPOCH, 2]
            outlet.offer(alarm(2))
            await eventually(lambda: "alarm/error/joint_fault" in consumer.keys(), "an alarm")  # noqa: SIM118


async def test_an_item_that_cannot_be_encoded_costs_only_itself(
    consumer: Consumer, outlet: ZenohOutlet, caplog: pytest.LogCaptureFixture
) -> None:
    outlet.offer(replace(batch(0, 3), values=batch(0, 2).values))
    outlet.offer(batch(3, 2))
    await consumer.until(1)
    assert mark_of(consumer.samples[0]).sequence == 3
    assert "an item of raw/arm/samples cannot be encoded" in caplog.text
    assert outlet.account.dropped == {"not encodable": 3}
    assert outlet.account.residue == 0


class Bus:
    """A session whose receivers take each put after 30 ms of its own ``clock``, s; ``broken``, it declares nothing."""

    def __init__(self) -> None:
        self.puts: list[str] = []
        self.clock, self.broken = 1.0, False

    def put(self, key: str) -> None:
        self.puts.append(key)
        self.clock += 0.2

    def declare_publisher(self, key: str, **_: Any) -> Any:
        if self.broken:
            raise zenoh.ZError("closed")
        return SimpleNamespace(put=lambda *_, **__: self.put(key))

    def liveliness(self) -> Any:
        return SimpleNamespace(declare_token=lambda _: None)


async def test_a_receiver_that_is_slow_with_results_holds_up_the_loop_once_in_a_while(
    outlet: ZenohOutlet, monkeypatch: pytest.MonkeyPatch
) -> None:
    bus: Any = Bus()
    outlet._publisher = Publisher(bus, outlet._keys, outlet.account, outlet._seal)
    monkeypatch.setattr(publisher, "time", SimpleNamespace(monotonic=lambda: bus.clock))
    for number in range(10):
        outlet.offer(Event(number, "arm", "connected", "arm: it answers"))
    outlet.offer(alarm(1))
    outlet.offer(Prediction("power", 3, (5,), {"power": (1.0,)}, {"power": "W"}))
    told = ["event", "alarm/error/joint_fault", "prediction/power"]
    assert [key.removeprefix(f"{ROOT}/") for key in bus.puts] == told
    assert outlet.account.counters == {"not published: a slow receiver": 9}
    assert outlet._ends["event"][1] == 10, "consumers see that they miss nine"
    bus.clock += 1.0
    outlet.offer(Event(10, "arm", "connected", "arm: it answers"))
    assert len(bus.puts) == 4
    assert outlet.account.residue == 0


async def test_a_session_that_breaks_while_a_key_is_declared_ends_the_outlet(outlet: ZenohOutlet) -> None:
    bus: Any = Bus()
    outlet._publisher = Publisher(bus, outlet._keys, outlet.account, outlet._seal)
    bus.broken = True
    outlet.offer(alarm(1))
    with pytest.raises(OutletError, match="Zenoh session: closed"):
        await outlet._publisher.watch(outlet.settings)
    assert outlet.account.dropped == {"session": 1} and outlet.account.residue == 0


async def test_a_peer_that_reaches_nobody_says_so_once(
    view: FakeView, endpoint: str, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(publisher, "_UNCONNECTED", 0.2)
    caplog.set_level("INFO")
    outlet = ZenohOutlet("zenoh", ZenohSettings(connect=(endpoint,)), view)
    async with doing(outlet.run()):
        await eventually(lambda: outlet.health({}) or "no link for" in caplog.text, "no link")
        with await asyncio.to_thread(open_session, LinkSettings(listen=(endpoint,))):
            await eventually(lambda: outlet.health({}) or "connected again" in caplog.text, "the link")
    assert caplog.text.count("no link for") == 1
    assert f"{endpoint}: no answer" in caplog.text
