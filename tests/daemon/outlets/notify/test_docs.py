"""The page about notifications: its settings are right, and its program checks signatures."""

from __future__ import annotations

import asyncio
from contextlib import suppress
from pathlib import Path
from typing import Any

import aiohttp
import pytest
import yaml

from cellwatt.config import load
from cellwatt.outlets.notify.settings import NotifySettings
from tests.daemon.outlets.notify.cell import View, alarm, outlet, running
from tests.docs.pages import Block, blocks
from tests.patience import eventually

PAGE = "outlets/notify.md"
NEEDED = {"site": "plant-1", "cell": "weld-3", "sources": {"arm": {"driver": "ur", "host": "192.0.2.10"}}}
SECRETS = dict.fromkeys(("MAIL_PASSWORD", "HOOK_SECRET", "NTFY_TOKEN", "HOME_TOKEN"), "not-a-real-secret")


@pytest.mark.parametrize("block", blocks(PAGE, "yaml"), ids=str)
def test_settings_of_the_page(block: Block, tmp_path: Path) -> None:
    file = tmp_path / "cell.yaml"
    file.write_text(f"{block.text}\n{yaml.safe_dump(NEEDED)}")
    settings = load(file, SECRETS).outlets["notify"].settings
    assert isinstance(settings, NotifySettings)
    assert settings.to


async def test_the_receiver_takes_what_we_sign_and_nothing_else(tmp_path: Path) -> None:
    (block,) = blocks(PAGE, "python")
    names: dict[str, Any] = {"__name__": "receiver"}
    exec(compile(block.text, PAGE, "exec"), names)
    heard: list[str] = []
    runner = aiohttp.web.AppRunner(names["application"]("a secret", heard.append))
    await runner.setup()
    await aiohttp.web.TCPSite(runner, "127.0.0.1", 0).start()
    url = f"http://127.0.0.1:{runner.addresses[0][1]}/alarms"
    try:
        right = outlet(View(tmp_path), {"desk": {"webhook": {"url": url, "secret": "a secret"}}})
        async with running(right):
            right.offer(alarm(3))
            await eventually(lambda: right.account.counters["desk: sent"])
            assert heard == ["[plant-1/weld-3] error: Joint 3 is loaded 12 Nm more than it should be"]
        wrong = outlet(View(tmp_path), {"desk": {"webhook": {"url": url, "secret": "another"}}})
        async with running(wrong):
            wrong.offer(alarm(4))
            await eventually(
                lambda: wrong.account.counters["desk: undelivered"] + wrong.account.counters["desk: retried"]
            )
        assert len(heard) == 1
        assert not right.account.counters["desk: undelivered"]
    finally:
        with suppress(asyncio.CancelledError):
            await runner.cleanup()
