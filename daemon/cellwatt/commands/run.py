"""``cellwatt run``: the daemon."""

from __future__ import annotations

import asyncio
import gc
import logging
import signal
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click

from cellwatt.config import CellConfig, load
from cellwatt.errors import CellwattError, ConfigError
from cellwatt.runtime import systemd
from cellwatt.runtime.cell import Cell

log = logging.getLogger("cellwatt")

SWITCH_INTERVAL = 0.0005
"""Longest time, s, a thread keeps the interpreter while the event loop waits (Python's default is 5 ms)."""
CONNECTED = 5.0
"""s after the start at which devices are connected, as a rule, and their drivers have loaded all they need."""


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--verbose", "-v", is_flag=True, help="Log debug messages.")
def command(file: Path, verbose: bool) -> None:
    """Run the cell described in FILE until SIGTERM; SIGHUP applies what changed in it."""
    logging.basicConfig(
        level=logging.DEBUG if verbose else logging.INFO,
        stream=sys.stderr,
        format="%(levelname)s %(name)s: %(message)s",
    )
    config = load(file)
    sys.setswitchinterval(SWITCH_INTERVAL)
    asyncio.run(serve(config))


async def serve(config: CellConfig) -> None:
    """Run a cell with signals and systemd connected."""
    cell = Cell(config)
    loop = asyncio.get_running_loop()
    reloads = _Reloads(cell, config.path)

    def stop() -> None:
        systemd.notify(STOPPING="1")
        cell.stop()

    for number in (signal.SIGTERM, signal.SIGINT):
        loop.add_signal_handler(number, stop)
    loop.add_signal_handler(signal.SIGHUP, reloads.ask)
    cell.view.on_health = _tell_systemd
    try:
        await cell.run(_ready)
    finally:
        await reloads.end()


def _ready() -> None:
    systemd.notify(READY="1")
    # What is there now stays: to search all of it for garbage holds up the loop by 40 ms and more, now and then.
    gc.collect()
    gc.freeze()
    asyncio.get_running_loop().call_later(CONNECTED, gc.freeze)


class _Reloads:
    """Reads the settings again when asked: asked while that is under way, once more after it, so the last file wins."""

    def __init__(self, cell: Cell, path: Path) -> None:
        self._cell, self._path = cell, path
        self._asked = False
        self._task: asyncio.Task[None] | None = None

    def ask(self) -> None:
        """Reload now, or after the reload under way."""
        self._asked = True
        if self._task is None:
            self._task = asyncio.get_running_loop().create_task(self._serve())

    async def end(self) -> None:
        """Give up the reload under way."""
        if self._task is not None:
            self._task.cancel()
            await asyncio.wait([self._task])

    async def _serve(self) -> None:
        try:
            while self._asked:
                self._asked = False
                await _reload(self._cell, self._path)
        finally:
            self._task = None


async def _reload(cell: Cell, path: Path) -> None:
    systemd.reloading()
    try:
        config = await asyncio.to_thread(load, path)
        log.info("%s", await cell.reload(config))
    except ConfigError as error:
        log.error("not reloaded, the old settings stay in force:\n%s", error)  # noqa: TRY400
    except CellwattError as error:
        log.error("not reloaded: %s", error)  # noqa: TRY400
    finally:
        systemd.notify(READY="1")


def _tell_systemd(status: Mapping[str, Any]) -> None:
    up = sum(s["state"] == "ok" for s in status["sources"].values())
    text = f"{status['state']}: {up} of {len(status['sources'])} sources up, {len(status['alarms'])} alarms"
    reason = " ".join(status["reasons"][0].split()) if status["reasons"] else ""
    systemd.notify(WATCHDOG="1", STATUS=f"{text}; {reason}" if reason else text)
