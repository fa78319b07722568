"""Mosquitto and Prometheus as children of the demo, with settings of their own in the demo's folder."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import shutil
import time
from collections.abc import AsyncIterator, Sequence
from importlib.resources import files
from pathlib import Path
from typing import Final

from cellwatt.child import ends_with_parent
from cellwatt.demo.processes import ended
from cellwatt.errors import CellwattError, why

START: Final = 30.0
"""Longest time, s, until a program listens."""
SCRAPE: Final = "1s"
_SYSTEM: Final = "/usr/sbin:/usr/local/sbin"
"""Folders in which Debian has servers, and users have no path."""


def find(program: str) -> str | None:
    """Path of an installed program."""
    return shutil.which(program) or shutil.which(program, path=_SYSTEM)


@contextlib.asynccontextmanager
async def mosquitto(program: str, folder: Path, address: str) -> AsyncIterator[None]:
    """Run a broker that keeps nothing on disk. Raises ``CellwattError`` if it does not come up."""
    host, _, port = address.rpartition(":")
    lines = [f"listener {port} {host}", "allow_anonymous true", "persistence false", "log_dest stderr"]
    if os.geteuid() == 0:
        lines.append("user root")  # it would become a user who cannot read the folder
    file = folder / "mosquitto.conf"
    await asyncio.to_thread(file.write_text, "\n".join(lines) + "\n")
    async with _running([program, "-c", str(file)], folder / "mosquitto.log", address):
        yield


@contextlib.asynccontextmanager
async def prometheus(program: str, folder: Path, address: str, target: str) -> AsyncIterator[None]:
    """Run a Prometheus that scrapes ``target`` each second and has our alert rules.

    Raises ``CellwattError`` if it does not come up.
    """
    rules = Path(str(files("cellwatt.outlets.metrics"))) / "ship" / "alerts.yaml"
    cell = {"targets": [target], "labels": {"site": "demo", "cell": "demo"}}
    config = {
        "global": {"scrape_interval": SCRAPE, "scrape_timeout": SCRAPE, "evaluation_interval": SCRAPE},
        "scrape_configs": [{"job_name": "cellwatt", "static_configs": [cell]}],
        "rule_files": [str(rules)],
    }
    file = folder / "prometheus.yaml"
    await asyncio.to_thread(file.write_text, json.dumps(config, indent=2))
    options = [f"--config.file={file}", f"--storage.tsdb.path={folder / 'prometheus'}"]
    options += [f"--web.listen-address={address}", "--log.level=warn"]
    async with _running([program, *options], folder / "prometheus.log", address):
        yield


@contextlib.asynccontextmanager
async def _running(command: Sequence[str], log: Path, address: str) -> AsyncIterator[None]:
    """Run a program until the end of the block, which begins when it listens at ``address``."""
    try:
        with log.open("wb") as out:
            process = await asyncio.create_subprocess_exec(
                *command, stdin=asyncio.subprocess.DEVNULL, stdout=out, stderr=out, preexec_fn=ends_with_parent()
            )
    except OSError as error:
        raise CellwattError(f"{command[0]} cannot be started: {why(error)}") from error
    async with ended(process, tell=True):
        await _until_listening(process, log, address)
        yield


async def _until_listening(process: asyncio.subprocess.Process, log: Path, address: str) -> None:
    host, _, port = address.rpartition(":")
    end = time.monotonic() + START
    while time.monotonic() < end:
        if process.returncode is not None:
            said = (await asyncio.to_thread(log.read_text, errors="replace")).strip().splitlines()
            words = f": {said[-1]}" if said else ""
            raise CellwattError(f"{log.stem} ended with exit code {process.returncode}{words}")
        with contextlib.suppress(OSError):
            _, writer = await asyncio.open_connection(host, int(port))
            writer.close()
            return
        await asyncio.sleep(0.05)
    raise CellwattError(f"{log.stem} did not listen at {address} within {START:.0f} s")
