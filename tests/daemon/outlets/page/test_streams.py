"""Browsers that follow: one that reads nothing costs only itself."""

from __future__ import annotations

import asyncio
import socket
from dataclasses import replace

import aiohttp
import pytest
from aiohttp import web

from cellwatt import FrameChannel, Layout
from cellwatt.outlets.page import streams
from cellwatt.outlets.page.gate import Gate
from cellwatt.outlets.page.streams import Browser, Browsers
from tests.daemon.outlets.page.cell import API, PREDICTION, Served, Stream, client, frames, get, served
from tests.patience import eventually

WIDE = Layout(tuple(FrameChannel(f"arm.c_{i}", "1", "continuous", "linear") for i in range(60)), 50.0)
NAMES = ",".join(WIDE.names)


async def mute(page: Served) -> socket.socket:
    """A browser that asks for all channels and then reads nothing."""
    host, port = page.url.removeprefix("http://").split(":")
    made = socket.socket()
    made.setblocking(False)
    made.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    loop = asyncio.get_running_loop()
    await loop.sock_connect(made, (host, int(port)))
    asked = f"GET {API}/stream?channels={NAMES}&rate=25 HTTP/1.1\r\nHost: {host}:{port}\r\n\r\n"
    await loop.sock_sendall(made, asked.encode())
    return made


async def test_a_browser_that_reads_nothing_costs_only_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streams, "MOST_VALUES", 5000)
    async with served() as page, client() as browser:
        silent = await mute(page)
        try:
            async with browser.get(f"{page.url}{API}/stream?channels=arm.c_0&rate=25") as response:
                stream, got, sent = Stream(response), [], 0
                await eventually(lambda: len(page.feed.hub) == 2, "both browsers")
                while not page.browsers.counts["blocks dropped"]:
                    page.feed.take_frames(frames(sent, 25, WIDE))
                    sent += 25
                    while len(got) < sent:
                        got += (await stream.until("frames"))["t"]
                assert got == [t / 1e6 for t in frames(0, sent, WIDE).time.tolist()], "the other got every frame"
                (stalled,) = [each for each in page.feed.hub.members if each.dropped]
                assert sum(map(len, stalled.frames)) * 61 <= 5000
        finally:
            silent.close()
        await eventually(lambda: page.feed.take_gap("x") or len(page.browsers) == 0, "both have left")


async def test_a_browser_that_leaves_before_its_answer_is_no_mistake(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    async def leave(_gate: Gate, request: web.Request, _response: web.StreamResponse) -> None:
        assert isinstance(request.transport, asyncio.Transport)
        request.transport.abort()

    monkeypatch.setattr(Gate, "prepare", leave)
    async with served() as page, client() as browser:
        with pytest.raises(aiohttp.ClientError):
            await browser.get(f"{page.url}{API}/stream")
        await eventually(lambda: not len(page.browsers), "its place")
    assert "cannot be answered" not in caplog.text


async def test_a_browser_that_takes_nothing_for_long_is_disconnected(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streams, "STALLED", 0.2)
    async with served() as page:
        silent = await mute(page)
        await eventually(lambda: len(page.feed.hub), "the browser")
        sent = 0
        while page.browsers.counts["browsers too slow"] == 0:
            page.feed.take_frames(frames(sent, 25, WIDE))
            sent += 25
            await asyncio.sleep(0.01)
        await eventually(lambda: len(page.browsers) == 0, "its place")
        silent.close()


async def test_frames_go_before_any_event_does(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streams, "MOST_BYTES", 100)
    monkeypatch.setattr(streams, "MOST_VALUES", 100)
    browser = Browser(Browsers(1).counts, WIDE.names, 100.0)
    browser.put(b"alarm" * 10)
    for number in range(5):
        browser.put_frames(frames(number, 1, WIDE))
    browser.put(b"clear" * 10)
    assert await browser._next() == b'event: behind\ndata: {"dropped":4}\n\n', "it is told how much it missed"
    assert [await browser._next() for _ in range(2)] == [b"alarm" * 10, b"clear" * 10]
    assert (await browser._next()).startswith(b"event: frames")
    for _ in range(3):
        browser.put(b"alarm" * 10)
    assert browser._ended, "one that cannot even take events has to ask anew"
    for number in range(5):
        browser.put(b"alarm" * 50)
        browser.put_frames(frames(number, 1, WIDE))
    assert not browser._events and not browser.frames, "nothing waits for one that has ended"
    assert browser._counts["browsers too slow"] == 1


async def test_a_browser_that_is_seldom_told_misses_no_frame_for_that() -> None:
    counts = Browsers(1).counts
    browser = Browser(counts, WIDE.names, 0.02)
    for second in range(50):
        browser.put_frames(frames(50 * second, 50, WIDE))
    assert sum(map(len, browser.frames)) == 2500 and not counts


async def test_frames_that_break_their_contract_cost_no_stream(caplog: pytest.LogCaptureFixture) -> None:
    browser, sound = Browser(Browsers(1).counts, WIDE.names), frames(0, 1, WIDE)
    browser.predictions.append(PREDICTION)
    browser.put_frames(replace(sound, values=sound.values[:, :3]))
    assert (await browser._next()).startswith(b"event: prediction")
    assert "frames cannot be shown" in caplog.text


async def test_there_is_a_limit_of_browsers() -> None:
    async with served(browsers=2) as page, client() as browser:
        url = f"{page.url}{API}/stream"
        async with browser.get(url) as first, browser.get(url) as second:
            assert (first.status, second.status) == (200, 200)
            assert "2 browsers are connected" in (await get(browser, url, 503))["error"]
        page.feed.take_gap("x")
        await eventually(lambda: page.feed.take_gap("x") or len(page.browsers) == 0, "room")
        async with browser.get(url) as again:
            assert again.status == 200


async def test_a_quiet_stream_beats(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(streams, "HEARTBEAT", 0.01)
    async with served() as page, client() as browser, browser.get(f"{page.url}{API}/stream") as response:
        lines = [await response.content.readline() for _ in range(5)]
        assert lines[0].startswith(b"retry: ")
        assert b": still here\n" in lines
