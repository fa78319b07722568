"""What the benchmark counts is what was sent."""

from __future__ import annotations

import asyncio

import aiohttp
from capacity.bus import SITE, Topic, as_arguments, free_port
from capacity.children import child
from capacity.wire import historian, passing

from tests.patience import wait_until


def test_readers_count_what_cells_publish_through_a_router() -> None:
    place = f"tcp/127.0.0.1:{free_port()}"
    link = {"connect": [place]}
    topics = as_arguments([Topic("raw/arm/rtde", 50.0, 700), Topic("frame", 10.0, 300)])
    with (
        child("route", listen=[place]) as router,
        child("publish", link=link, cells=2, topics=topics) as cells,
        child("read", link=link, keys=[f"cellwatt/{SITE}/*/**"], sessions=2) as readers,
    ):
        for process in (router, cells, readers):
            process.ready()
        wait_until(lambda: cells.ask(0.1) and all(len(told["topics"]) == 2 for told in readers.ask("tell")))
        wait_until(lambda: not any(told["topics"] for told in readers.ask("tell")))
        sent = cells.ask(1.0)
        got = [{}, {}]
        wait_until(lambda: _added(got, readers.ask("tell")) == 2 * [2 * (50 + 10)])
    assert (sent["messages"], sent["bytes"]) == (120, 2 * (50 * 700 + 10 * 300))
    assert got == [{"raw/arm/rtde": [100, 70_000], "frame": [20, 6000]}] * 2


def _added(counts, told):
    """Messages of each reader so far, with what it tells now added to its counts."""
    for count, new in zip(counts, told, strict=True):
        for topic, (messages, size) in new["topics"].items():
            before = count.get(topic, [0, 0])
            count[topic] = [before[0] + messages, before[1] + size]
    return [sum(messages for messages, _ in count.values()) for count in counts]


async def test_bytes_are_counted_both_ways() -> None:
    async def answer(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(bytes(70_000 if await reader.readexactly(1000) else 0))
        writer.close()
        await writer.wait_closed()

    server = await asyncio.start_server(answer, "127.0.0.1", 0)
    async with server, passing(server.sockets[0].getsockname()[1]) as counted:
        reader, writer = await asyncio.open_connection("127.0.0.1", counted.port)
        writer.write(bytes(1000))
        assert len(await reader.read(-1)) == 70_000
        writer.close()
        await writer.wait_closed()
    assert (counted.sent, counted.received) == (1000, 70_000)


async def test_a_historian_takes_lines_and_counts_their_bytes() -> None:
    async with historian() as counted, aiohttp.ClientSession() as session:
        for _ in range(2):
            async with session.post(f"http://127.0.0.1:{counted.port}/write", data=bytes(1234)) as answer:
                assert answer.status == 204
    assert counted.sent == 2468
