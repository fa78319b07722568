"""A port with bounds: who comes in beyond them, who has to go, and what a want of descriptors costs."""

from __future__ import annotations

import asyncio
import logging
import os
import resource
import socket
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager, suppress

import aiohttp
import pytest
from aiohttp import web

from cellwatt.door import http, port
from cellwatt.door.http import HttpDoor
from cellwatt.door.port import Limits, Port, peer_of
from cellwatt.door.settings import Listening
from cellwatt.errors import OutletError
from tests.patience import eventually

FEW = Limits(connections=8, peer=4, head=0.2)
LONG = Limits(connections=8, peer=4)


class Peer:
    """Opens connections to a door, and closes them in the end."""

    def __init__(self, url: str) -> None:
        self.url = url
        self._writers: list[asyncio.StreamWriter] = []

    async def connect(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        host, number = self.url.removeprefix("http://").split(":")
        reader, writer = await asyncio.open_connection(host, int(number))
        self._writers.append(writer)
        return reader, writer

    async def get(self) -> str:
        async with aiohttp.ClientSession() as session, session.get(self.url) as answer:
            return await answer.text()

    async def close(self) -> None:
        for writer in self._writers:
            writer.close()
            with suppress(OSError):
                await writer.wait_closed()


@asynccontextmanager
async def serving(limits: Limits) -> AsyncIterator[tuple[HttpDoor, Peer]]:
    held = asyncio.Event()

    async def hello(_: web.Request) -> web.Response:
        return web.Response(text="hello")

    async def hold(_: web.Request) -> web.Response:
        await held.wait()
        return web.Response(text="held")

    app = web.Application()
    app.add_routes([web.get("/", hello), web.post("/", hello), web.get("/hold", hold)])
    door = HttpDoor(app, Listening(listen="127.0.0.1:0"), limits)
    peer = Peer(await door.start(None))
    try:
        yield door, peer
    finally:
        held.set()
        await peer.close()
        await door.stop()


async def test_idle_connections_make_room_for_who_asks() -> None:
    async with serving(LONG) as (door, peer):
        idle = await asyncio.gather(*(peer.connect() for _ in range(20)))
        await eventually(lambda: door.counts["connections displaced"] == 16)
        assert await peer.get() == "hello"
        assert door.counts["connections displaced"] == 17
        assert len(door) <= LONG.peer
        ended = [reader for reader, _ in idle if reader.at_eof() or reader.exception() is not None]
        assert len(ended) == 17


async def test_a_connection_at_work_is_not_displaced() -> None:
    async with serving(LONG) as (door, peer):
        at_work = [await peer.connect() for _ in range(4)]
        for _, writer in at_work:
            writer.write(b"GET /hold HTTP/1.1\r\nHost: here\r\n\r\n")
        await asyncio.sleep(0.1)
        with pytest.raises(aiohttp.ClientError):
            await peer.get()
        assert door.counts["connections refused"] >= 1
        assert not any(reader.at_eof() for reader, _ in at_work)


@pytest.mark.parametrize("said", [b"", b"GET / HTTP/1.1\r\nHost: he"])
async def test_the_head_of_a_request_has_a_deadline(monkeypatch: pytest.MonkeyPatch, said: bytes) -> None:
    monkeypatch.setattr(port, "SWEEP", 0.02)
    async with serving(FEW) as (door, peer):
        reader, writer = await peer.connect()
        writer.write(said)
        with suppress(ConnectionError):
            assert await asyncio.wait_for(reader.read(), 5) == b""
        assert door.counts["connections timed out"] == 1
        assert await peer.get() == "hello"


async def test_the_body_of_a_request_has_a_deadline(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(http, "BODY", 0.1)
    async with serving(LONG) as (_, peer):
        reader, writer = await peer.connect()
        writer.write(b"POST / HTTP/1.1\r\nHost: here\r\nContent-Length: 100\r\n\r\nabc")
        assert (await asyncio.wait_for(reader.read(), 5)).startswith(b"HTTP/1.1 408")


async def test_what_is_no_http_is_not_logged(caplog: pytest.LogCaptureFixture) -> None:
    async with serving(LONG) as (door, peer):
        for said in (b"GET / HTTP/9.9\r\n\r\n", b"\x16\x03\x01 nonsense\r\n\r\n", b"X" * 20_000):
            reader, writer = await peer.connect()
            writer.write(said)
            assert (await asyncio.wait_for(reader.readline(), 5)).startswith(b"HTTP/1.0 400")
        assert door.counts["requests malformed"] >= 1
        assert not [record for record in caplog.records if record.name != "asyncio"]


async def test_a_want_of_descriptors_costs_a_pause_and_a_line(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(port, "PAUSE", 0.05)
    caplog.set_level(logging.WARNING)
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    async with serving(LONG) as (door, peer):
        number = os.open("/dev/null", os.O_RDONLY)
        os.close(number)
        resource.setrlimit(resource.RLIMIT_NOFILE, (number + 1, hard))
        try:
            late = await peer.connect()  # takes the last descriptor, so that the door has none
            await eventually(lambda: door.counts["connections not accepted"] >= 2)
            assert len(caplog.records) == door.counts["connections not accepted"] < 20
        finally:
            resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
        late[1].write(b"GET / HTTP/1.1\r\nHost: here\r\n\r\n")
        assert (await asyncio.wait_for(late[0].readline(), 5)).startswith(b"HTTP/1.1 200")


@pytest.mark.parametrize(
    ("address", "peer"),
    [
        ("192.0.2.7", "192.0.2.7"),
        ("::1", "::1"),
        ("::ffff:192.0.2.7", "192.0.2.7"),
        ("2001:db8::1", "2001:db8::/64"),
        ("fe80::1%eth0", "fe80::/64"),
    ],
)
def test_a_peer_is_a_host_whatever_its_address(address: str, peer: str) -> None:
    assert peer_of(address) == peer


async def test_an_address_that_this_pc_lacks_keeps_no_other_from_being_served(monkeypatch: pytest.MonkeyPatch) -> None:
    """As ``localhost`` where IPv6 is turned off."""
    elsewhere = (socket.AF_INET6, socket.SOCK_STREAM, 6, "", ("2001:db8::1", 0, 0, 0))
    here = (socket.AF_INET, socket.SOCK_STREAM, 6, "", ("127.0.0.1", 0))
    found = [elsewhere, here]
    monkeypatch.setattr(asyncio.get_running_loop(), "getaddrinfo", lambda *_, **__: asyncio.sleep(0, found))
    opened = Port(asyncio.Protocol, Limits())
    number = await opened.open("localhost", 0)
    assert [listener.getsockname() for listener in opened._listeners] == [("127.0.0.1", number)]
    await opened.close()
    found.remove(here)
    with pytest.raises(OutletError, match="cannot listen at localhost:0: "):
        await opened.open("localhost", 0)
