"""The demo: emulated devices, the daemon and a subscriber as processes, a fault, and what came of it."""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
import signal
import socket
import sys
import time
from collections import Counter
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Any

from cellwatt.emulation import ArmSignals, EmulatorProcess
from cellwatt.errors import CellwattError

JOINT = 3
"""The elbow."""
SPRING = {"stiffness": 60.0, "rest": 1.4}
"""Nm/rad, hooked on where the elbow is at home: seed 002's spring of 10 N at 0.3 m, at this arm's size."""
DEVICES = {
    "arm": ("ur", "127.0.0.1:0", "1.0"),
    "board": ("power_board", "pty", "1.0"),
    "positioner": ("yaskawa", "127.0.0.1:0", "0.8", "--option", "answer_ms=2"),
    "mains": ("scpi_analyzer", "127.0.0.1:0", "0.8"),
}
"""Source, its driver, where the emulator listens, and how fast its arm moves."""
FAULTY = ("arm", "board")
"""Emulators that share the arm on whose elbow the spring is hooked."""
START = 20.0
"""Longest time, s, until everything runs."""


def settings_file() -> Path:
    """The demo's cell: packaged, or in examples/ of a checkout."""
    packaged = Path(str(files("cellwatt"))) / "examples" / "demo.yaml"
    return packaged if packaged.exists() else Path(__file__).resolve().parents[3] / "examples" / "demo.yaml"


@dataclass
class Seen:
    """What the subscriber said it got."""

    samples: Counter[str] = field(default_factory=Counter)
    first: dict[str, int] = field(default_factory=dict)
    """Number of the first sample after the subscriber joined, by topic."""
    gaps: int = 0
    intervals: list[dict[str, Any]] = field(default_factory=list)
    tasks: int = 0
    alarms: list[dict[str, Any]] = field(default_factory=list)
    status: dict[str, Any] = field(default_factory=dict)

    def add(self, line: Mapping[str, Any]) -> None:
        """Take one line of ``cellwatt watch --json``."""
        kind, content = line["kind"], line["content"]
        if kind in {"raw", "frame"}:
            self.samples[line["topic"]] += content["count"]
            self.first.setdefault(line["topic"], line["sequence"])
        elif kind == "gap":
            self.gaps += 1
        elif kind == "interval" and content["closed"]:
            self.intervals.append(content)
        elif kind == "task":
            self.tasks += 1
        elif kind == "alarm":
            self.alarms.append({**content, "received": line["received"]})
        elif kind == "health":
            self.status = content


@dataclass
class Demonstration:
    """One run. ``show`` is called with each line of the subscriber, and with what the demo itself does."""

    folder: Path
    seconds: float
    show: Callable[[Mapping[str, Any]], None]
    say: Callable[[str], None]
    seen: Seen = field(default_factory=Seen)
    hooked: float = 0.0
    """UTC s at which the spring was hooked on."""

    async def run(self) -> dict[str, Any]:
        """Run it; the summary, JSON-ready. Raises ``CellwattError`` when a process does not start."""
        epoch = time.time()
        async with contextlib.AsyncExitStack() as stack:
            emulators = {}
            for number, (name, (driver, address, speed, *more)) in enumerate(DEVICES.items()):
                arguments = ("--listen", address, "--epoch", str(epoch), "--speed", speed, "--seed", str(number), *more)
                emulators[name] = await stack.enter_async_context(EmulatorProcess(driver, *arguments))
            endpoint = f"tcp/127.0.0.1:{_free_port()}"
            daemon = await stack.enter_async_context(self._daemon(emulators, endpoint))
            watching = await stack.enter_async_context(self._subscriber(endpoint))
            reading = asyncio.create_task(self._read(watching))
            try:
                await self._until_running(daemon, watching)
                await self._play(emulators, epoch)
                daemon.send_signal(signal.SIGTERM)
                await asyncio.wait_for(daemon.wait(), 15)
                await asyncio.sleep(0.5)
            finally:
                with contextlib.suppress(ProcessLookupError):
                    watching.terminate()
                await asyncio.wait([reading], timeout=5)
                reading.cancel()
        return summary(self.seen, self.hooked, daemon.returncode)

    async def _play(self, emulators: Mapping[str, EmulatorProcess], epoch: float) -> None:
        self.say(f"running for {self.seconds:.0f} s; the spring comes halfway")
        start = time.time()
        self.hooked = next_start(start + self.seconds / 2, epoch)
        await asyncio.sleep(self.hooked - 0.5 - time.time())
        for name in FAULTY:
            await emulators[name].disturb(spring=float(JOINT), at=self.hooked - epoch, **SPRING)
        self.say(f"a spring is hooked on joint {JOINT} of {FAULTY[0]}")
        await asyncio.sleep(max(0.0, start + self.seconds - time.time()))

    async def _until_running(self, daemon: asyncio.subprocess.Process, watching: asyncio.subprocess.Process) -> None:
        end = time.monotonic() + START
        while time.monotonic() < end:
            states = [s["state"] for s in self.seen.status.get("sources", {}).values()]
            if states and all(s == "ok" for s in states):
                return
            for name, process in (("daemon", daemon), ("subscriber", watching)):
                if process.returncode is not None:
                    raise CellwattError(f"the {name} ended with exit code {process.returncode}")
            await asyncio.sleep(0.05)
        raise CellwattError(f"not everything ran within {START:.0f} s: {json.dumps(self.seen.status)[:400]}")

    @contextlib.asynccontextmanager
    async def _daemon(
        self, emulators: Mapping[str, EmulatorProcess], endpoint: str
    ) -> AsyncIterator[asyncio.subprocess.Process]:
        environment = dict(os.environ, CELLWATT_DEMO_FOLDER=str(self.folder), CELLWATT_DEMO_ENDPOINT=endpoint)
        for name, emulator in emulators.items():
            place, _, port = emulator.address.rpartition(":")
            upper = name.upper()
            environment |= (
                {f"CELLWATT_DEMO_{upper}_HOST": place, f"CELLWATT_DEMO_{upper}_PORT": port}
                if place
                else {f"CELLWATT_DEMO_{upper}_PORT": emulator.address}
            )
        log = (self.folder / "daemon.log").open("wb")
        command = [sys.executable, "-m", "cellwatt.commands", "run", str(settings_file())]
        with log:
            process = await asyncio.create_subprocess_exec(*command, env=environment, stderr=log)
        try:
            yield process
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()

    @contextlib.asynccontextmanager
    async def _subscriber(self, endpoint: str) -> AsyncIterator[asyncio.subprocess.Process]:
        topics = [x for kind in ("raw", "frame", "interval", "task", "alarm", "health") for x in ("--topic", kind)]
        command = [sys.executable, "-m", "cellwatt.commands", "watch", "--json", "--connect", endpoint]
        command += ["--site", "demo", "--cell", "demo", *topics]
        process = await asyncio.create_subprocess_exec(*command, stdout=asyncio.subprocess.PIPE)
        try:
            yield process
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        assert process.stdout is not None
        while line := await process.stdout.readline():
            message = json.loads(line)
            self.seen.add(message)
            self.show(message)


def next_start(after: float, epoch: float) -> float:
    """UTC s of the next moment after ``after`` at which the elbow of the emulated arm starts to move."""
    arm = ArmSignals()
    repetition = int((after - epoch) // arm.period)
    starts = [epoch + (repetition + r) * arm.period + s for r in (0, 1) for s in arm.starts(JOINT)]
    return min(s for s in starts if s >= after)


def summary(seen: Seen, hooked: float, exit_code: int | None) -> dict[str, Any]:
    """What the run gave, and everything that is not as it should be under ``problems``."""
    sources = {name: _source(name, status, seen) for name, status in seen.status.get("sources", {}).items()}
    fault = _fault(seen, hooked)
    problems = [p for name, s in sources.items() for p in _source_problems(name, s)] + _fault_problems(fault)
    if exit_code != 0:
        problems.append(f"the daemon ended with exit code {exit_code}")
    if set(sources) != set(DEVICES):
        problems.append(f"sources seen: {', '.join(sources) or 'none'}")
    if seen.gaps:
        problems.append(f"{seen.gaps} gaps at the subscriber")
    frames = seen.status.get("frames", {})
    if frames.get("count") != seen.samples["frame"] + seen.first.get("frame", 0):
        problems.append(f"{frames.get('count')} frames were made, the subscriber got {seen.samples['frame']}")
    return {
        "ok": not problems,
        "problems": problems,
        "sources": sources,
        "frames": seen.samples["frame"],
        "intervals": len(seen.intervals),
        "tasks": seen.tasks,
        "fault": fault,
        "alarms": [{k: a[k] for k in ("kind", "severity", "joint", "active", "statement")} for a in seen.alarms],
    }


def _source(name: str, status: Mapping[str, Any], seen: Seen) -> dict[str, Any]:
    streams = {
        stream: {k: figures[k] for k in ("nominal_hz", "rate_hz", "jitter_p50_ms", "jitter_p99_ms")}
        | {"samples": figures["samples"], "delivered": seen.samples[f"raw/{name}/{stream}"]}
        | {"before_subscriber": seen.first.get(f"raw/{name}/{stream}", 0)}
        for stream, figures in status["streams"].items()
    }
    lost = sum(status["missed"].values()) + sum(status["dropped"].values())
    kept = ("expected", "received", "missed", "dropped", "residue")
    return {k: status[k] for k in kept} | {"lost": lost, "streams": streams}


def _source_problems(name: str, source: Mapping[str, Any]) -> list[str]:
    problems = []
    if source["lost"] or source["residue"]:
        problems.append(f"{name}: {source['lost']} samples lost, {source['residue']} not accounted for")
    for stream, s in source["streams"].items():
        if s["delivered"] + s["before_subscriber"] != s["samples"]:
            problems.append(f"{name}/{stream}: {s['samples']} samples, {s['delivered']} at the subscriber")
        if s["nominal_hz"] and (s["rate_hz"] is None or abs(s["rate_hz"] / s["nominal_hz"] - 1) > 0.02):
            problems.append(f"{name}/{stream}: {s['rate_hz']} Hz instead of {s['nominal_hz']} Hz")
    return problems


def _fault(seen: Seen, hooked: float) -> dict[str, Any]:
    """The first alarm that names a fault, and the interval in which the spring began to act."""
    at = hooked * 1e9
    alarms = [a for a in seen.alarms if a["kind"].endswith("_fault") and a["active"]]
    acting = [i for i in seen.intervals if JOINT in i["moving"] and i["end"] > at]
    first = alarms[0] if alarms else None
    return {
        "joint": JOINT,
        "early_alarms": sum(a["received"] < at for a in alarms),
        "named_joint": first["joint"] if first else None,
        "statement": first["statement"] if first else None,
        "delay_s": round((first["received"] - at) * 1e-9, 3) if first else None,
        "interval_s": round((acting[0]["end"] - acting[0]["start"]) * 1e-9, 3) if acting else None,
    }


def _fault_problems(fault: Mapping[str, Any]) -> list[str]:
    if fault["named_joint"] is None:
        return ["no alarm named the fault"]
    problems = []
    if fault["early_alarms"]:
        problems.append(f"{fault['early_alarms']} alarms before the fault")
    if fault["named_joint"] != fault["joint"]:
        problems.append(f"the alarm names joint {fault['named_joint']}, the spring is on {fault['joint']}")
    if fault["interval_s"] is None or fault["delay_s"] > fault["interval_s"]:
        problems.append(f"the alarm came after {fault['delay_s']} s, the interval lasted {fault['interval_s']} s")
    return problems


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port
