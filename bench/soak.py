"""A daemon with all its outlets, whose peers are cut, slow, silent and lying, and whose processes are killed.

    python bench/soak.py --minutes 60 --kills 10 --seed 1

A UR arm, a power board and a source that is not there, with frames at 20 Hz. Pushed: MQTT and InfluxDB (Debian's
servers), a webhook of blocks, a lake, alarms to people. Asked: a subscriber over Zenoh, the page, metrics, OPC UA,
Foxglove. Each is reached through a line of its own, whose state changes every few seconds, and ``--kills`` times each
collect, judge and tell are killed with SIGKILL. In the end all lines are well, and what each peer has is held against
what the recording has: ``missing``, ``extra``, ``twice``. ``uneven`` are looks at health at which an account had a
residue.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import random
import signal
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import AsyncIterator, Awaitable, Callable
from contextlib import AsyncExitStack, asynccontextmanager, suppress
from pathlib import Path
from typing import Any, get_args

import aiohttp
import aiomqtt
import numpy as np
import psutil
import pyarrow.dataset as ds
import yaml
from aiohttp import web
from aiohttp.test_utils import TestServer
from asyncua import Client as OpcUa
from websockets import connect
from websockets.typing import Subprotocol

from cellwatt.emulation import EmulatorProcess
from cellwatt.frames import Frames
from cellwatt.record import Recording
from cellwatt.results import Alarm
from cellwatt.subscriber import Gap, Health, LinkSettings, Subscriber
from cellwatt.testing.outlet_rig import Line, State, line_to

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from bench.influxd import influxd
from tests.daemon.outlets.mqtt.broker import Broker, free_port

SITE, CELL = "bench", "cell"

SPAN = 10**8
"""ns between two rows of those that are sent 10 a second."""
KILLED = ("collect", "judge", "tell")
LEAST, SETTLING = 45.0, 600.0
"""s after the last cut in which all that is owed must come, the least and the most."""


class Soak:
    """What all peers got."""

    def __init__(self, lines: dict[str, Line], ports: dict[str, int]) -> None:
        self.lines, self.ports = lines, ports
        self.rows: defaultdict[str, list[int]] = defaultdict(list)
        """Times of rows or frames, UTC ns, by peer, as they came."""
        self.refused: set[int] = set()
        self.refuse = False
        self.told: Counter[tuple[str, str]] = Counter()
        """Ids of alarms with what happened, as people were told."""
        self.answers: Counter[str] = Counter()
        self.back: list[str] = []
        """Counters of the metrics that went back."""
        self.gaps = 0
        self.uneven: list[tuple[str, Any]] = []
        self.status: dict[str, Any] = {}
        self.begun = asyncio.Event()

    # peers that are told --------------------------------------------------------------------------

    async def blocks(self, request: web.Request) -> web.Response:
        """The webhook of blocks."""
        times = [m["time"] for m in await request.json() if "values" in m]
        if self.refuse:
            self.refused.update(times)
            return web.Response(status=422)
        self.rows["hook"] += times
        return web.Response(status=204)

    async def people(self, request: web.Request) -> web.Response:
        """The webhook of alarms."""
        self.told.update((alarm["id"], alarm["happened"]) for alarm in (await request.json())["alarms"])
        return web.Response(status=204)

    async def broker(self) -> None:
        """What the broker has, for as long as it lives."""
        async with aiomqtt.Client("127.0.0.1", self.ports["broker"], protocol=aiomqtt.ProtocolVersion.V5) as client:
            await client.subscribe("cellwatt/#", 1)
            async for message in client.messages:
                if str(message.topic).endswith("/frame"):
                    self.rows["mqtt"].append(json.loads(bytes(message.payload))["time"])

    # peers that ask -------------------------------------------------------------------------------

    async def zenoh(self, place: str, want: tuple[str, ...]) -> None:
        """Follow the cell."""
        async with Subscriber(SITE, CELL, LinkSettings(mode="client", connect=(f"tcp/{place}",)), want=want) as cell:
            async for message in cell:
                content = message.content
                if isinstance(content, Frames):
                    self.rows["zenoh"] += content.time.tolist()
                elif isinstance(content, Gap) and want == ("frame",):
                    self.gaps += content.count
                elif isinstance(content, Health):
                    self.status = dict(content.status)
                    if "processes" in self.status:
                        self.begun.set()
                    parts = {**self.status["sources"], **self.status["sinks"]}
                    self.uneven += [(name, part["residue"]) for name, part in parts.items() if part["residue"]]

    async def metrics(self) -> None:
        """Scrape, and hold counters against those before."""
        before: dict[str, float] = {}
        async with aiohttp.ClientSession(timeout=aiohttp.ClientTimeout(total=15)) as session:
            while True:
                text = await _got(session, f"http://{self.lines['metrics'].address}/metrics")
                told = (line for line in text.splitlines() if not line.startswith("#"))
                lines = (line.rsplit(" ", 1) for line in told if "_total{" in line or "_total " in line)
                now = {name: float(value) for name, value in lines}
                if now["cellwatt_scrapes_total"] < before.get("cellwatt_scrapes_total", 0.0):
                    before = {}  # `tell` was killed: Prometheus takes that for what it is, a reset of all
                self.back += [n for n, value in now.items() if value < before.get(n, 0.0)]
                before |= now
                self.answers["metrics"] += 1
                await asyncio.sleep(5)

    async def page(self) -> None:
        """Look at the page."""
        async with aiohttp.ClientSession(timeout=aiohttp.ClientTimeout(total=15)) as session:
            while True:
                await _got(session, f"http://{self.lines['page'].address}/")
                self.answers["page"] += 1
                await asyncio.sleep(2)

    async def opc_ua(self) -> None:
        """Read the server's clock."""
        async with OpcUa(f"opc.tcp://{self.lines['opc_ua'].address}/cellwatt", timeout=15) as client:
            while True:
                await client.get_node("i=2258").read_value()
                self.answers["opc_ua"] += 1
                await asyncio.sleep(2)

    async def foxglove(self) -> None:
        """Subscribe to all topics."""
        place = f"ws://{self.lines['foxglove'].address}"
        async with connect(place, subprotocols=[Subprotocol("foxglove.sdk.v1")], max_size=None) as socket:
            async for message in socket:
                if isinstance(message, bytes):
                    self.answers["foxglove"] += 1
                elif (said := json.loads(message))["op"] == "advertise":
                    wanted = [{"id": c["id"], "channelId": c["id"]} for c in said["channels"]]
                    await socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


async def _got(session: aiohttp.ClientSession, url: str) -> str:
    async with session.get(url) as answer:
        answer.raise_for_status()
        return await answer.text()


async def again(work: Callable[[], Awaitable[None]]) -> None:
    """Work, again after each end: lines are cut all the time."""
    while True:
        with suppress(Exception):
            await work()
        await asyncio.sleep(0.5)


async def trouble(soak: Soak, minutes: float, kills: int, rnd: random.Random) -> Counter[str]:
    """Change the lines, and kill; returns what was done."""
    done: Counter[str] = Counter()
    end = time.monotonic() + 60 * minutes
    deaths = sorted((rnd.uniform(time.monotonic() + 5, end), part) for part in KILLED for _ in range(kills))
    while (now := time.monotonic()) < end:
        while deaths and deaths[0][0] < now:
            _, part = deaths.pop(0)
            pids = (p["pid"] for name, p in soak.status["processes"].items() if name.split()[0] == part)
            try:
                os.kill(next(pids), signal.SIGKILL)
                done[f"{part} killed"] += 1
            except (ProcessLookupError, StopIteration):  # it has just been begun again, and health does not know it yet
                deaths.insert(0, (now + 2.0, part))
        name = rnd.choice(list(soak.lines))
        state = rnd.choice(["well", *get_args(State)])
        soak.lines[name].be(state)
        done[state] += 1
        soak.refuse = rnd.random() < 0.03
        await asyncio.sleep(rnd.uniform(0.2, 3.0))
    for line in soak.lines.values():
        line.be("well")
    soak.refuse = False
    return done


@asynccontextmanager
async def process(log: Path, *words: str, **more: str) -> AsyncIterator[asyncio.subprocess.Process]:
    """A command of cellwatt."""
    with log.open("w") as out:
        command = [sys.executable, "-m", "cellwatt.commands", *words]
        made = await asyncio.create_subprocess_exec(*command, stdout=out, stderr=out, env={**os.environ, **more})
    try:
        yield made
    finally:
        if made.returncode is None:
            made.send_signal(signal.SIGTERM)
        await made.wait()


def settings(lines: dict[str, Line], ports: dict[str, int], sources: dict[str, Any], folder: Path) -> dict[str, Any]:
    """The cell's file."""
    web_ = {name: f"http://{lines[name].address}/{name}" for name in ("hook", "people")}
    influx = {"url": f"http://{lines['influx'].address}", "database": "plant", "rate": "10 Hz", "timeout": "10 s"}
    people = {"webhook": {"url": web_["people"]}, "severity": "info", "group": "0 s"}
    return {
        "site": SITE,
        "cell": CELL,
        "sources": {**sources, "absent": {"driver": "scpi_analyzer", "host": "127.0.0.1", "port": free_port()}},
        "stages": {"segment": {}},
        "frames": {"rate": "20 Hz"},
        "record": {"folder": str(folder / "record")},
        "zenoh": {"listen": [f"tcp/127.0.0.1:{ports['zenoh']}"]},
        "mqtt": {
            "broker": f"mqtt://{lines['mqtt'].address}",
            "rate": "10 Hz",
            "keep_alive": "5 s",
            "backfill": "1 kHz",
        },
        "historian": {"influx": influx, "lake": {"folder": str(folder / "lake"), "rate": "10 Hz", "every": "20 s"}},
        "notify": {"timeout": "10 s", "retry": "1 s", "to": {"people": people}},
        "hook": {"url": web_["hook"], "rate": "10 Hz", "timeout": "10 s", "batch": 500},
        **{name: {"listen": f"127.0.0.1:{ports[name]}"} for name in ("page", "metrics", "opc_ua")},
    }


def found(soak: Soak, folder: Path) -> dict[str, Any]:
    """What each peer has beside what the recording has."""
    recording = Recording.open(folder / "record")
    told = [(f.time, np.isfinite(f.values).any(axis=1)) for f in recording.frames()]
    frames, filled = (np.concatenate(each) for each in zip(*told, strict=True))
    rows, needed = ({int(t) for t in -(-times // SPAN) * SPAN} for times in (frames, frames[filled]))
    soak.rows["lake"] = ds.dataset(folder / "lake" / "frames").to_table(["time"])["time"].cast("int64").to_pylist()
    peers = {}
    for name, got in soak.rows.items():
        due, most = (set(frames.tolist()),) * 2 if name == "zenoh" else (needed, rows)
        if name == "zenoh":
            due = {t for t in due if t >= min(got)}
        # The row that was begun at the end comes with the next start, and the last of the lake with its next file.
        until = frames[-1] - (30 if name == "lake" else 1) * 10**9
        missing = sorted(t for t in due - set(got) - (soak.refused if name == "hook" else set()) if t < until)
        counts = {"due": len(due), "missing": len(missing), "extra": len(set(got) - most)}
        peers[name] = {**counts, "twice": len(got) - len(set(got)), "first missing": [t / 1e9 for t in missing[:5]]}
    raised = {a.id for a in recording.results(Alarm) if a.active}
    untold = sorted(raised - {id_ for id_, what in soak.told if what == "raised"})
    twice = sum(n > 1 for (_, what), n in soak.told.items() if what == "raised")
    peers["people"] = {"due": len(raised), "missing": len(untold), "twice": twice, "first missing": untold[:5]}
    return peers


async def soaked(minutes: float, kills: int, seed: int, folder: Path) -> dict[str, Any]:
    """Run it."""
    async with AsyncExitStack() as stack:
        broker = Broker(folder)
        stack.callback(broker.kill)
        await broker.again()
        (folder / "influx").mkdir()
        influx = await stack.enter_async_context(influxd(folder / "influx"))
        lines: dict[str, Line] = {}
        ports = {name: free_port() for name in ("zenoh", "page", "metrics", "opc_ua", "foxglove")}
        soak = Soak(lines, ports | {"broker": broker.port})
        app = web.Application(client_max_size=2**26)
        app.add_routes([web.post("/hook", soak.blocks), web.post("/people", soak.people)])
        told = (await stack.enter_async_context(TestServer(app))).port
        targets = {
            **ports,
            "mqtt": broker.port,
            "influx": int(influx.at.rpartition(":")[2]),
            "hook": told,
            "people": told,
        }
        for name, port in targets.items():
            peer: Any = argparse.Namespace(address=f"127.0.0.1:{port}")
            lines[name] = await stack.enter_async_context(line_to(peer))
        arm = await stack.enter_async_context(EmulatorProcess("ur", "--listen", "127.0.0.1:0"))
        board = await stack.enter_async_context(EmulatorProcess("power_board", "--listen", "pty"))
        host, _, port = arm.address.rpartition(":")
        sources = {
            "arm": {"driver": "ur", "host": host, "port": int(port), "rate": "125 Hz"},
            "board": {"driver": "power_board", "port": board.address},
        }
        file = folder / "cell.yaml"
        file.write_text(yaml.safe_dump(settings(lines, ports, sources, folder)))
        daemon = await stack.enter_async_context(process(folder / "log", "run", str(file), PYTHONPATH=_hook(folder)))
        place = f"127.0.0.1:{ports['zenoh']}"
        where = ("--connect", f"tcp/{place}", "--site", SITE, "--cell", CELL)
        view = ("view", *where, "--foxglove", "--listen", f"127.0.0.1:{ports['foxglove']}")

        async def viewing() -> None:
            async with process(folder / "foxglove.log", *view) as made:
                await made.wait()

        work: list[Callable[[], Awaitable[None]]] = [
            viewing, soak.broker, soak.metrics, soak.page, soak.opc_ua, soak.foxglove,
            lambda: soak.zenoh(lines["zenoh"].address, ("frame",)), lambda: soak.zenoh(place, ("health",)),
        ]  # fmt: skip
        async with asyncio.TaskGroup() as group:
            running = [group.create_task(again(each)) for each in work]
            await soak.begun.wait()
            began = psutil.cpu_times()
            done = await trouble(soak, minutes, kills, random.Random(seed))
            before = Counter(soak.answers)
            await asyncio.sleep(LEAST)
            for _ in range(round(SETTLING - LEAST)):
                if any(outlet.get("owed") for outlet in soak.status["sinks"].values()):
                    await asyncio.sleep(1.0)
            last = {name: (o["error"], o.get("owed", 0)) for name, o in soak.status["sinks"].items()}
            counted = {name: dict(o) for name, o in soak.status["sinks"].items()}
            daemon.send_signal(signal.SIGTERM)
            await daemon.wait()
            await asyncio.sleep(3.0)
            for task in running:
                task.cancel()
        soak.rows["influx"] = [row["time"] for row in await influx.query("SELECT * FROM cellwatt")]
        peers = found(soak, folder)
        return {
            "done": dict(done),
            "peers": peers,
            "gaps": soak.gaps,
            "uneven": soak.uneven[:20],
            "counters that went back": sorted(set(soak.back))[:20],
            "answers after the last cut": dict(soak.answers - before),
            "error and owed at the end": last,
            "accounts": {n: {k: v for k, v in o.items() if k in _ACCOUNT} for n, o in counted.items()},
            "processor s": round(psutil.cpu_times().user - began.user, 1),
        }


_ACCOUNT = ("expected", "received", "missed", "dropped", "owed", "residue")


def _hook(folder: Path) -> str:
    """The outlet that ``cellwatt new-outlet`` makes, as if it were installed; gives the path of modules."""
    about = folder / "soak_hook-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: soak-hook\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(
        "[cellwatt.outlets]\nhook = cellwatt.testing.outlet_skeleton:SkeletonOutlet\n"
    )
    return os.pathsep.join(filter(None, (str(folder), os.environ.get("PYTHONPATH"))))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--kills", type=int, default=10)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for the record and the logs")
    a = parser.parse_args()
    folder = a.keep or Path(tempfile.mkdtemp())
    folder.mkdir(exist_ok=True)
    print(json.dumps(asyncio.run(soaked(a.minutes, a.kills, a.seed, folder)), indent=1))


if __name__ == "__main__":
    main()
