"""The page about notifications: its settings are right, and its program checks signatures."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from aiohttp.test_utils import TestServer

from tests.daemon.outlets.notify.cell import View, alarm, offered, running
from tests.docs.pages import blocks
from tests.patience import eventually

PAGE = "outlets/notify.md"


async def test_the_receiver_takes_what_we_sign_and_nothing_else(tmp_path: Path) -> None:
    (block,) = blocks(PAGE, "python")
    names: dict[str, Any] = {"__name__": "receiver"}
    exec(compile(block.text, PAGE, "exec"), names)
    heard: list[str] = []
    async with TestServer(names["application"]("a secret", heard.append)) as server:
        url = str(server.make_url("/alarms"))
        async with running(View(tmp_path), {"desk": {"webhook": {"url": url, "secret": "a secret"}}}) as right:
            await offered(right, alarm(3), "desk: sent")
            assert heard == ["[plant-1/weld-3] error: Joint 3 is loaded 12 Nm more than it should be"]
        async with running(View(tmp_path), {"desk": {"webhook": {"url": url, "secret": "another"}}}) as wrong:
            wrong.offer(alarm(4))
            await eventually(
                lambda: wrong.account.counters["desk: undelivered"] + wrong.account.counters["desk: retried"]
            )
        assert len(heard) == 1
        assert not right.account.counters["desk: undelivered"]
