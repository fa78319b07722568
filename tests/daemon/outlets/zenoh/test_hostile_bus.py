"""What others can put on a cell's keys: what the cell says still comes, once.

A stranger's messages have right marks and checksums: they are made by the code that makes the cell's.
"""

from __future__ import annotations

import asyncio
import io
import json
from collections.abc import AsyncIterator
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import zenoh

from cellwatt import ProtocolError
from cellwatt.outlets.zenoh.answer_queue import Answer
from cellwatt.outlets.zenoh.encode import decode, encode
from cellwatt.outlets.zenoh.link import open_session
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import encode_item, encode_json, health
from cellwatt.subscriber import Gap, Health, Subscriber
from tests.daemon.outlets.zenoh.fake_cell import CELL, EPOCH, SITE, alarm, batch
from tests.daemon.outlets.zenoh.test_messages import DEEP
from tests.daemon.outlets.zenoh.test_subscriber import RAW, Cell, cell, read
from tests.patience import PATIENCE, eventually

__all__ = ["cell"]

ROOT = f"cellwatt/{SITE}/{CELL}"
FUTURE = EPOCH + 10**18
"""A session that began 30 years after the cell's."""
LEAP = 10**6


class Stranger:
    """Somebody who may publish on the cell's keys."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session

    def put(self, path: str, payload: bytes, mark: Mark | None) -> None:
        attachment = None if mark is None else mark.encode(payload)
        self.session.put(f"{ROOT}/{path}", payload, attachment=attachment)

    def raw(self, session: int, first: int, count: int = 5, topic: str = RAW) -> None:
        self.put(topic, encode(batch(0, count)), Mark(session, first, count, EPOCH))

    def alarm(self, session: int, number: int, count: int = 1) -> None:
        mark = Mark(session, number, count, EPOCH)
        self.put("alarm/error/joint_fault", encode_item(alarm(1), mark), mark)

    def health(self, session: int, positions: dict[str, tuple[int, int]]) -> None:
        mark = Mark(session, 7, 1, EPOCH)
        self.put("health", health(mark, session, positions, {"state": "red"}), mark)


@pytest.fixture
async def stranger(cell: Cell) -> AsyncIterator[Stranger]:
    with await asyncio.to_thread(open_session, cell.link, patience=PATIENCE) as session:
        yield Stranger(session)


async def looked_into(stranger: Stranger, subscriber: Subscriber) -> None:
    """Wait until the subscriber has read all that the stranger put, and has asked the cell where it had to."""
    stranger.put("health", b"", None)
    await eventually(lambda: subscriber.counts.get("unreadable"), "all of it to be read")
    await eventually(lambda: not subscriber._inbox.following._unsure, "the cell's answer")


async def only_the_truth(cell: Cell, subscriber: Subscriber, first: int) -> None:
    """What the cell says next comes, in its place, and nothing was called lost or doubled."""
    cell.give(first, 5)
    (message,) = await read(subscriber, 1, RAW)
    assert (message.session, message.sequence, message.count, message.backfilled) == (EPOCH, first, 5, False)
    assert isinstance(message.content, type(batch(0, 1)))
    assert "lost" not in subscriber.counts
    assert subscriber.counts["duplicates"] == 0


async def test_a_session_that_the_cell_does_not_name_is_not_entered(cell: Cell, stranger: Stranger) -> None:
    async with cell.joined(want=("raw", "alarm"), patience=0.2) as subscriber:
        cell.give(0, 5)
        cell.outlet.offer(alarm(1))
        await read(subscriber, 2)
        stranger.raw(FUTURE, 0)
        stranger.alarm(FUTURE, 0)
        stranger.health(FUTURE, {RAW: (FUTURE, 10**12)})
        await looked_into(stranger, subscriber)
        await only_the_truth(cell, subscriber, 5)
        cell.outlet.offer(alarm(1, active=False))
        (message,) = await read(subscriber, 1, "alarm")
        assert (message.sequence, message.content) == (1, alarm(1, active=False))


async def test_a_true_restart_is_followed_beside_a_forged_one(cell: Cell, stranger: Stranger) -> None:
    """The cell ends and begins anew on the same port in a later session, while somebody claims one still later."""
    later = EPOCH + 60 * 10**9
    async with cell.joined(want=("raw", "health"), patience=0.2) as subscriber:
        cell.give(0, 5)
        await read(subscriber, 1, RAW)
        stranger.raw(FUTURE, 0)
        stranger.health(FUTURE, {RAW: (FUTURE, 10)})
        await looked_into(stranger, subscriber)
        cell.view.session = later
        item = batch(0, 5)
        cell.view.record(item, later)
        cell.outlet.offer(item)
        (message,) = await read(subscriber, 1, RAW)
        assert (message.session, message.sequence) == (later, 0)
        healthy: Any = None
        while healthy is None or healthy.session != later:
            (message,) = await read(subscriber, 1, "health")
            healthy = message.content
            assert isinstance(healthy, Health)
            assert healthy.session in (EPOCH, later)
        assert "lost" not in subscriber.counts


# what cannot be a message --------------------------------------------------------------------------------


def packed() -> bytes:
    """A batch of two million equal rows, packed."""
    rows = pa.ipc.open_stream(encode(batch(0, 1))).read_next_batch().take(pa.array(np.zeros(2_000_000, np.int64)))
    out = io.BytesIO()
    with pa.ipc.new_stream(out, rows.schema, options=pa.ipc.IpcWriteOptions(compression="zstd")) as writer:
        writer.write_batch(rows)
    return out.getvalue()


def test_what_is_small_and_unpacks_to_much_is_not_unpacked() -> None:
    payload = packed()
    assert len(payload) < 1_000_000
    before = pa.total_allocated_bytes()
    with pytest.raises(ProtocolError, match="its columns are compressed"):
        decode(payload, Mark(EPOCH, 0, 2_000_000, EPOCH))
    assert pa.total_allocated_bytes() - before < 1_000_000


MARK = Mark(EPOCH, 0, 1, EPOCH)


NO_MESSAGES: list[tuple[str, bytes, Mark | None]] = [
    ("alarm/error/joint_fault", DEEP, MARK),
    ("alarm/error/joint_fault", encode_item(alarm(1), MARK), replace(MARK, count=10**9)),
    ("alarm/error/joint_fault", encode_item(alarm(1), MARK), replace(MARK, sequence=-1)),
    (RAW, encode(batch(0, 5)), replace(MARK, sequence=2**63 - 2, count=5)),
    (RAW, encode(batch(0, 0)), replace(MARK, count=0)),
    ("health", DEEP, MARK),
    ("health", b'{"session": 1, "time": 1, "positions": {"frame": [1, 9223372036854775808]}, "status": {}}', MARK),
    ("health", encode_json({"positions": {f"raw/a{i}/b": (1, 1) for i in range(2000)}}), MARK),
    ("health", b'{"session": 1, "time": 1, "positions": {}, "status": {}}', None),
    ("raw/%FF/\u00e4\u2028", b"", None),
]


async def test_what_is_no_message_ends_nothing(cell: Cell, stranger: Stranger) -> None:
    async with cell.joined() as subscriber:
        for number, message in enumerate(NO_MESSAGES, 1):
            stranger.put(*message)
            await eventually(lambda n=number: subscriber.counts.get("unreadable") == n, f"the refusal of {message[:2]}")  # type: ignore[misc]
        await only_the_truth(cell, subscriber, 0)


async def test_a_large_result_is_not_read(cell: Cell, stranger: Stranger, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("cellwatt.outlets.zenoh.received._LARGEST_JSON", 1000)
    async with cell.subscriber(want=("event",)) as subscriber:
        await eventually(lambda: subscriber._session is not None, "the session")
        large = b'"' + b"x" * 2000 + b'"'
        # Again and again: the first ones may come before the router knows the subscription.
        await eventually(
            lambda: stranger.put("event", large, MARK) or subscriber.counts.get("unreadable"), "the refusal"
        )


async def test_topics_in_health_that_are_no_topics_are_not_asked_for(cell: Cell, stranger: Stranger) -> None:
    async with cell.joined(want=("raw", "alarm", "frame")) as subscriber:
        cell.give(0, 5)
        await read(subscriber, 1, RAW)
        odd = ("raw/a", "raw/a/b/c", "raw/*/x", "alarm/**", "frame?x", "raw//", "raw/a/" + "b" * 5000)
        stranger.health(EPOCH, dict.fromkeys(odd, (EPOCH, 9)))
        stranger.put("health", b"", None)
        await eventually(lambda: subscriber.counts.get("unreadable"), "all of it to be read")
        assert not subscriber._inbox.following._unsure


async def test_an_answer_about_something_else_is_not_taken(cell: Cell, monkeypatch: pytest.MonkeyPatch) -> None:
    """Somebody answers in the cell's place with samples of another session."""
    async with cell.joined(want=("raw",), patience=0.3) as subscriber:
        mark = Mark(FUTURE, LEAP, 5, EPOCH, backfill=True)
        forged = Answer(encode(batch(0, 5)), "application/vnd.apache.arrow.stream", mark, RAW)
        monkeypatch.setitem(cell.outlet._answers._known, "history", lambda _: forged)
        cell.give(0, 4, live=False)
        cell.give(4, 5)
        gap, live = await read(subscriber, 2)
    assert isinstance(gap.content, Gap)
    assert "the answer has 1000000 to 1000005 in session" in gap.content.reason
    assert (gap.count, live.session, live.sequence) == (4, EPOCH, 4)


# the mark of health ----------------------------------------------------------------------------------------


async def test_health_has_the_mark_of_every_message(cell: Cell, stranger: Stranger) -> None:
    heard: list[zenoh.Sample] = []
    stranger.session.declare_subscriber(f"{ROOT}/health", heard.append)
    await eventually(lambda: len(heard) >= 3, "health")
    marks = [Mark.decode(s.attachment.to_bytes(), s.payload.to_bytes()) for s in heard]
    numbers = [m.sequence for m in marks]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    assert {(m.session, m.count, m.backfill) for m in marks} == {(marks[0].session, 1, False)}
    for sample, mark in zip(heard, marks, strict=True):
        body = json.loads(sample.payload.to_bytes())
        assert body["mark"] == {"session": mark.session, "sequence": mark.sequence}
        assert body["time"] == mark.arrival
    (reply,) = await asyncio.to_thread(lambda: list(stranger.session.get(f"{ROOT}/@/status", timeout=10.0)))
    mark = Mark.decode(reply.ok.attachment.to_bytes(), reply.ok.payload.to_bytes())
    assert mark.backfill
    assert mark.sequence > numbers[-1]
