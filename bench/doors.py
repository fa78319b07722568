"""All doors of one cell attacked at once, on loopback: what that costs the record, and what the daemon says of it.

    python bench/doors.py [--seconds 300] [--log FILE] [--only idle slow garbage guesses flood opc_ua zenoh reloads]

A daemon with an emulated arm (500 Hz) and power board serves the page (users), metrics (token), OPC UA (users), Zenoh,
and the Foxglove app beside it. Each attack goes on against every door that it fits:

``idle``     connections that say nothing, opened again whenever the door hangs up, 300 at a time for each door
``slow``     a byte of a request each second
``garbage``  random bytes, and requests with odd heads
``guesses``  wrong tokens and passwords, as fast as they are answered
``flood``    right requests as fast as they are answered
``opc_ua``   a Read of 50,000 nodes, messages without an end, chunks of nonsense
``zenoh``    odd questions, and questions with 60 kB sent along
``reloads``  SIGHUP with another file each time, right and wrong in turns

Meanwhile one honest reader scrapes the metrics once a second. Told are: samples lost by source and by the record,
alarms, bytes of the log, descriptors and memory of the process that tells, and what the honest reader got.
"""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import json
import logging
import random
import signal
import sys
import tempfile
import time
from collections import Counter
from collections.abc import AsyncIterator, Awaitable, Callable
from pathlib import Path
from typing import Any

import aiohttp
import psutil

from cellwatt.demo.cells import free_endpoint
from cellwatt.emulation import EmulatorProcess
from cellwatt.outlets.page.sessions import hash_of
from cellwatt.outlets.zenoh.keys import QUESTIONS
from cellwatt.outlets.zenoh.link import LinkSettings, open_session
from cellwatt.record import Recording
from cellwatt.subscriber import Health, Subscriber

ATTACKS = ("idle", "slow", "garbage", "guesses", "flood", "opc_ua", "zenoh", "reloads")
IDLE = 300
TOKEN = "right-token-of-the-bench"
UP = 300.0
"""s for all that is to be up, on a PC that does much else."""
SETTLE = 5.0
"""s without attacks, before the figures are taken and after."""


class Cell:
    """A daemon as a process, its doors by name, and its log."""

    def __init__(self, folder: Path, arm: str, board: str) -> None:
        names = ("page", "metrics", "opc_ua", "zenoh", "foxglove")
        self.doors = {name: free_endpoint() for name in names}
        self.file, self.log = folder / "cell.yaml", folder / "log"
        host, _, port = arm.rpartition(":")
        self._text = f"""
site: bench
cell: doors
sources:
  arm: {{driver: ur, host: {host}, port: {port}}}
  board: {{driver: power_board, port: {board}}}
record: {{folder: {folder / "record"}}}
zenoh: {{listen: [tcp/{self.doors["zenoh"]}]}}
page: {{listen: "{self.doors["page"]}", users: {{ada: {{password: "{hash_of("right", 2**14)}"}}}}}}
opc_ua: {{listen: "{self.doors["opc_ua"]}", users: {{ada: right}}}}
"""
        self.reloads = 0
        self.write(0)

    def write(self, turn: int) -> None:
        """Put the settings; those of odd turns are wrong, and even ones differ in the metrics alone."""
        labels = f"labels: {{turn: t{turn}}}" if turn % 2 == 0 else "labels: wrong"
        metrics = f'metrics: {{listen: "{self.doors["metrics"]}", token: {TOKEN}, {labels}}}'
        self.file.write_text(f"{self._text}{metrics}\n")

    @contextlib.asynccontextmanager
    async def running(self) -> AsyncIterator[asyncio.subprocess.Process]:
        """The daemon and, beside it, the server for the Foxglove app."""
        run = [sys.executable, "-m", "cellwatt.commands"]
        show = ["--foxglove", "--site", "bench", "--cell", "doors", "--connect", f"tcp/{self.doors['zenoh']}"]
        with self.log.open("ab") as log:
            daemon = await asyncio.create_subprocess_exec(*run, "run", str(self.file), stderr=log)
            shown = await asyncio.create_subprocess_exec(
                *run, "view", *show, "--listen", self.doors["foxglove"], stderr=log, stdout=log
            )
        try:
            yield daemon
        finally:
            for process in (shown, daemon):
                if process.returncode is None:
                    process.send_signal(signal.SIGTERM)
                await process.wait()

    def tells(self, daemon: asyncio.subprocess.Process) -> psutil.Process:
        """The process that records and tells: that with most children of its own, or most memory."""
        children = psutil.Process(daemon.pid).children()
        return max(children, key=lambda child: (len(child.children()), child.memory_info().rss))


async def connect(address: str) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
    host, port = address.rsplit(":", 1)
    async with asyncio.timeout(5):
        return await asyncio.open_connection(host, int(port))


Attack = Callable[[Cell, str, Counter[str]], Awaitable[None]]


async def again(attack: Attack, cell: Cell, door: str, counts: Counter[str]) -> None:
    """One attack again and again, whatever it meets."""
    while True:
        try:
            await attack(cell, door, counts)
        except Exception as error:  # what a door does to an attacker is no concern of ours
            counts[f"{door}: {type(error).__name__}"] += 1
        await asyncio.sleep(0.01)


async def idle(cell: Cell, door: str, counts: Counter[str]) -> None:
    reader, writer = await connect(cell.doors[door])
    counts["connections"] += 1
    try:
        await reader.read()
    finally:
        writer.close()
    await asyncio.sleep(0.2)


async def slow(cell: Cell, door: str, counts: Counter[str]) -> None:
    reader, writer = await connect(cell.doors[door])
    reading = asyncio.ensure_future(reader.read())
    try:
        for byte in b"GET /metrics HTTP/1.1\r\nHost: 127.0.0.1\r\nX: " + bytes(1000):
            writer.write(bytes((byte,)))
            await asyncio.wait([reading], timeout=1.0)
            if reading.done():
                counts["slow requests cut off"] += 1
                return
    finally:
        reading.cancel()
        writer.close()


HEADS = (
    b"GET / HTTP/1.1\r\nHost: 127.0.0.1:1@evil\r\n\r\n",
    b"GET /metrics HTTP/1.1\r\nHost: 127.0.0.1\r\nAuthorization: Bearer \xff\xc3\xa4\r\n\r\n",
    b"POST /api/login HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Length: 99999999\r\n\r\n{",
    b"GET /" + b"a" * 100_000 + b" HTTP/1.1\r\n\r\n",
    b"GET / HTTP/1.1\r\n" + b"X: y\r\n" * 10_000 + b"\r\n",
    b"GET / HTTP/9.9\r\nTransfer-Encoding: chunked\r\nContent-Length: -1\r\n\r\nzz\r\n",
)


async def garbage(cell: Cell, door: str, counts: Counter[str]) -> None:
    reader, writer = await connect(cell.doors[door])
    try:
        writer.write(random.choice((*HEADS, random.randbytes(random.randrange(1, 5000)))))
        async with asyncio.timeout(2):
            await writer.drain()
            await reader.read(100)
        counts["garbage"] += 1
    finally:
        writer.close()


async def guesses(cell: Cell, door: str, counts: Counter[str]) -> None:
    if door == "opc_ua":
        await _guess_opc_ua(cell, counts)
        return
    async with aiohttp.ClientSession(cookie_jar=aiohttp.CookieJar(unsafe=True)) as session:
        if door == "metrics":
            header = {"Authorization": f"Bearer guess{random.random()}"}
            async with session.get(f"http://{cell.doors[door]}/metrics", headers=header) as answer:
                counts[f"metrics: guess answered {answer.status}"] += 1
            return
        async with session.get(f"http://{cell.doors[door]}/api/site") as answer:
            header = {"X-CSRF-Token": (await answer.json())["csrf"]}
        body = {"name": random.choice(("ada", "bob", "eve")), "password": "guess"}
        async with session.post(f"http://{cell.doors[door]}/api/login", json=body, headers=header) as answer:
            counts[f"page: guess answered {answer.status}"] += 1


async def _guess_opc_ua(cell: Cell, counts: Counter[str]) -> None:
    from asyncua import Client, ua

    client = Client(f"opc.tcp://{cell.doors['opc_ua']}/cellwatt", timeout=5)
    client.set_user("eve")
    client.set_password("guess")
    try:
        await client.connect()
    except (ua.UaError, OSError, TimeoutError, asyncio.CancelledError) as error:
        if isinstance(error, asyncio.CancelledError):
            raise
        counts[f"opc_ua: {type(error).__name__}"] += 1
    else:
        await client.disconnect()


async def flood(cell: Cell, door: str, counts: Counter[str]) -> None:
    paths = ("/healthz", "/readyz") if door == "metrics" else ("/", "/api/site")
    async with aiohttp.ClientSession(timeout=aiohttp.ClientTimeout(10)) as session:
        for _ in range(100):
            async with session.get(f"http://{cell.doors[door]}{random.choice(paths)}") as answer:
                await answer.read()
                counts[f"{door}: answered {answer.status}"] += 1


async def opc_ua(cell: Cell, door: str, counts: Counter[str]) -> None:
    reader, writer = await connect(cell.doors[door])
    try:
        hello = b"HELF" + (28 + 4 + 4).to_bytes(4, "little") + bytes(4) + 3 * (65535).to_bytes(4, "little")
        writer.write(random.choice((hello + bytes(12), b"MSGF\xff\xff\xff\x7f" + bytes(60_000), b"OPNF" + bytes(4))))
        for _ in range(20):
            writer.write(random.randbytes(20_000))
            async with asyncio.timeout(2):
                await writer.drain()
        counts["opc_ua messages"] += 1
        async with asyncio.timeout(1):
            await reader.read(100)
    finally:
        writer.close()


async def zenoh(cell: Cell, _door: str, counts: Counter[str]) -> None:
    """Odd questions, from a thread."""
    link = LinkSettings(mode="client", connect=(f"tcp/{cell.doors['zenoh']}",))

    def ask() -> None:
        with open_session(link) as session:
            for _ in range(50):
                key = random.choice([f"@/{name}" for name in QUESTIONS] + ["alarm/**", "raw/arm/rtde", "**"])
                odd = random.choice(("?cleared=-5", "?from=x", f"?{'a=b;' * 2000}", ""))
                payload = random.choice((None, random.randbytes(60_000)))
                list(session.get(f"cellwatt/bench/doors/{key}{odd}", payload=payload, timeout=2.0))
                counts["zenoh questions"] += 1

    await asyncio.to_thread(ask)


async def reloads(cell: Cell, daemon: asyncio.subprocess.Process, counts: Counter[str]) -> None:
    while True:
        await asyncio.sleep(1.5)
        counts["reloads"] += 1
        cell.write(counts["reloads"])
        daemon.send_signal(signal.SIGHUP)


FITS: dict[str, tuple[Attack, tuple[str, ...], int]] = {
    "idle": (idle, ("page", "metrics", "opc_ua", "zenoh", "foxglove"), IDLE),
    "slow": (slow, ("page", "metrics", "opc_ua", "zenoh", "foxglove"), 10),
    "garbage": (garbage, ("page", "metrics", "opc_ua", "zenoh", "foxglove"), 2),
    "guesses": (guesses, ("page", "metrics", "opc_ua"), 1),
    "flood": (flood, ("page", "metrics"), 1),
    "opc_ua": (opc_ua, ("opc_ua",), 2),
    "zenoh": (zenoh, ("zenoh",), 1),
}


async def honest(cell: Cell, counts: Counter[str]) -> None:
    """Scrape once a second, as Prometheus does."""
    header = {"Authorization": f"Bearer {TOKEN}"}
    while True:
        try:
            async with (
                aiohttp.ClientSession(timeout=aiohttp.ClientTimeout(5)) as session,
                session.get(f"http://{cell.doors['metrics']}/metrics", headers=header) as answer,
            ):
                await answer.read()
                counts[f"scrape {answer.status}"] += 1
        except (OSError, TimeoutError, aiohttp.ClientError) as error:
            counts[f"scrape {type(error).__name__}"] += 1
        await asyncio.sleep(1.0)


async def health_of(cell: Cell, up: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
    """The first health that is as wanted."""
    link = LinkSettings(mode="client", connect=(f"tcp/{cell.doors['zenoh']}",))
    status: dict[str, Any] = {}
    try:
        async with asyncio.timeout(UP), Subscriber("bench", "doors", link, want=("health",)) as subscriber:
            async for message in subscriber:
                if isinstance(message.content, Health) and up(status := dict(message.content.status)):
                    return status
    except TimeoutError:
        pass
    raise AssertionError(f"not up: {status.get('reasons')}\n{cell.log.read_text()[-3000:]}")


def delivers(status: dict[str, Any]) -> bool:
    """All sources deliver, and all doors are there."""
    outlets = status["sinks"].values()
    up = all(source["state"] == "ok" and source["received"] for source in status["sources"].values())
    return up and all(outlet["state"] == "ok" for outlet in outlets)


async def run(seconds: float, chosen: tuple[str, ...], keep: Path | None = None) -> dict[str, Any]:
    """Figures of an attack that goes on for so long."""
    counts: Counter[str] = Counter()
    async with contextlib.AsyncExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        arm = await stack.enter_async_context(EmulatorProcess("ur", "--listen", "127.0.0.1:0"))
        board = await stack.enter_async_context(EmulatorProcess("power_board", "--listen", "pty"))
        for device in (arm, board):  # what is lost is to be the daemon's
            device.be_punctual()
        cell = Cell(folder, arm.address, board.address)
        daemon = await stack.enter_async_context(cell.running())
        await _until_open(cell)
        await health_of(cell, delivers)
        await asyncio.sleep(SETTLE)
        before = await health_of(cell, delivers)
        tells = cell.tells(daemon)
        most: Counter[str] = Counter()
        tasks = [asyncio.create_task(honest(cell, counts))]
        for name in chosen:
            if name == "reloads":
                tasks.append(asyncio.create_task(reloads(cell, daemon, counts)))
                continue
            attack, doors, number = FITS[name]
            tasks += [asyncio.create_task(again(attack, cell, d, counts)) for d in doors for _ in range(number)]
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            await asyncio.sleep(1.0)
            most["descriptors"] = max(most["descriptors"], tells.num_fds())
            most["mb"] = max(most["mb"], round(tells.memory_info().rss / 1e6))
        left = set(tasks)
        while left:  # a client library may swallow the first
            for task in left:
                task.cancel()
            _, left = await asyncio.wait(left, timeout=1.0)
        await asyncio.sleep(SETTLE)
        after = await health_of(cell, lambda _: True)
        log, recorded = await asyncio.to_thread(_kept, cell, folder, keep)
    return {
        "seconds": seconds, **_figures(before, after), **recorded, "log_bytes": len(log),
        "log_lines": log.count("\n"), "tells": dict(most), "attackers": dict(sorted(counts.items())),
    }  # fmt: skip


def _kept(cell: Cell, folder: Path, keep: Path | None) -> tuple[str, dict[str, Any]]:
    """The log, and what the record has: samples that are missing in it, its damage and its alarms."""
    log = cell.log.read_text(errors="replace")
    if keep is not None:
        keep.write_text(log)
    record = Recording.open(folder / "record")
    streams = [(source, stream.name) for source, streams in record.streams.items() for stream in streams]
    numbers = {source: record.batches(source, stream).sequence for source, stream in streams}
    gaps = {source: int(found[-1] - found[0] + 1 - len(found)) for source, found in numbers.items() if len(found)}
    alarms = sorted({alarm.id for alarm in record.alarms() if alarm.active})
    return log, {"missing_in_record": gaps, "damage": [str(d) for d in record.damage], "alarms": alarms}


async def _until_open(cell: Cell) -> None:
    end = time.monotonic() + 60
    while time.monotonic() < end:
        with contextlib.suppress(OSError):
            _, writer = await connect(cell.doors["zenoh"])
            writer.close()
            return
        await asyncio.sleep(0.2)
    raise AssertionError(f"the daemon does not listen: {cell.log.read_text()[-2000:]}")


def _figures(before: dict[str, Any], after: dict[str, Any]) -> dict[str, Any]:
    lost = {
        name: sum(source[kind].get(why, 0) - before["sources"][name][kind].get(why, 0)
                  for kind in ("missed", "dropped") for why in source[kind])
        for name, source in after["sources"].items()
    }  # fmt: skip
    return {
        "state": after["state"],
        "received": {n: s["received"] - before["sources"][n]["received"] for n, s in after["sources"].items()},
        "lost": lost,
        "record_dropped": sum(after["recorder"]["drops"].values()),
        "skipped_bytes": {n: p.get("skipped_bytes", 0) for n, p in after["processes"].items()},
        "restarts": {n: p.get("restarts", 0) for n, p in after["processes"].items()},
        "doors": {name: outlet["counters"] for name, outlet in after["sinks"].items()},
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--only", nargs="*", choices=ATTACKS, default=ATTACKS)
    parser.add_argument("--log", type=Path, help="keep the daemon's log here")
    asked = parser.parse_args()
    logging.getLogger("asyncua").setLevel(logging.CRITICAL)
    print(json.dumps(asyncio.run(run(asked.seconds, tuple(asked.only), asked.log)), indent=2))


if __name__ == "__main__":
    main()
