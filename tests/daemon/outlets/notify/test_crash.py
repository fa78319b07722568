"""``kill -9`` in the middle of many alarms: each is told exactly once, counted by the id that messages keep."""

from __future__ import annotations

import asyncio
import sys
from collections import Counter
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

from aiohttp import web

from tests.daemon.outlets.notify.servers import Web, web_server
from tests.docs.pages import ROOT
from tests.patience import eventually

ALARMS, KILLS = 100, 2
MODULE = "tests.daemon.outlets.notify.outlet_process"


@asynccontextmanager
async def process(folder: Path, server: Web, first: int, count: int) -> AsyncIterator[None]:
    """The outlet in a process that is killed in the end."""
    arguments = [str(folder), server.url, str(first), str(count)]
    begun = await asyncio.create_subprocess_exec(sys.executable, "-m", MODULE, *arguments, cwd=ROOT)
    try:
        yield
    finally:
        begun.kill()
        await begun.wait()


def messages(server: Web, path: str) -> dict[str, list[int]]:
    """Alarms of each message by its id; every copy of it must be the same."""
    bodies: dict[str, bytes] = {}
    for call in server.calls:
        if call.path == path:
            assert bodies.setdefault(call.headers["webhook-id"], call.body) == call.body
    found = [call for call in server.calls if call.path == path]
    return {call.headers["webhook-id"]: [one["joint"] for one in call.json["alarms"]] for call in found}


def told(server: Web, count: int) -> bool:
    return all(sum(map(len, messages(server, path).values())) >= count for path in ("/one", "/two"))


async def test_each_alarm_exactly_once(tmp_path: Path) -> None:
    async def slowly(_: web.BaseRequest) -> web.StreamResponse:
        await asyncio.sleep(0.01)  # so that many are killed between taking and noting
        return web.Response()

    async with web_server() as server:
        server.answers = [slowly] * 10_000
        for kill in range(KILLS):
            before = len(server.calls)
            first, count = kill * ALARMS // KILLS, (kill + 1) * ALARMS // KILLS
            async with process(tmp_path, server, first, count):
                # A slow machine may tell all of this part in fewer messages.
                await eventually(lambda: len(server.calls) >= before + 6 or told(server, count))  # noqa: B023
        async with process(tmp_path, server, ALARMS, ALARMS):
            await eventually(lambda: told(server, ALARMS), "all alarms at both")
        for path in ("/one", "/two"):
            joints = Counter(joint for joints in messages(server, path).values() for joint in joints)
            assert joints == Counter(range(ALARMS))
        calls = Counter((call.path, call.headers["webhook-id"]) for call in server.calls)
        copies = calls.total() - len(calls)
        assert copies <= 2 * KILLS  # at most the one under way, of each recipient, at each kill
