"""A daemon as a process, devices as processes, and what a subscriber got from it."""

from __future__ import annotations

import asyncio
import contextlib
import os
import signal
import sys
import time
from collections import Counter, defaultdict
from collections.abc import AsyncIterator, Callable, Iterable
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

from cellwatt.batch import Batch
from cellwatt.demo.fault import next_start, spring
from cellwatt.emulation import EmulatorProcess
from cellwatt.errors import OutletError
from cellwatt.frames import Frames
from cellwatt.results import Alarm, Event
from cellwatt.subscriber import EVERYTHING, Gap, Health, LinkSettings, Subscriber
from tests.daemon.outlets.zenoh.processes import free_port
from tests.patience import PATIENCE, eventually

REFERENCE = Path(__file__).resolve().parents[2] / "examples" / "demo-reference.yaml"


class Daemon:
    """``cellwatt run`` on a settings text; ``folder`` holds the file, the recordings and the log.

    ``record`` are settings of the record beside its folder.
    """

    def __init__(self, folder: Path, text: str, port: int | None = None, record: str = "") -> None:
        self.folder = folder
        self.record = record
        self.endpoint = f"tcp/127.0.0.1:{port or free_port()}"
        self.file = folder / "cell.yaml"
        self.write(text)
        self.process: asyncio.subprocess.Process | None = None

    def write(self, text: str) -> None:
        """Put the settings; the record folder and the endpoint are added."""
        record = f"{{folder: {self.folder / 'record'}, {self.record}}}"
        more = f"record: {record}\nzenoh: {{listen: [{self.endpoint}]}}\n"
        self.file.write_text(f"site: test\ncell: test\n{text}\n{more}")

    @property
    def log(self) -> str:
        return (self.folder / "daemon.log").read_text()

    @property
    def link(self) -> LinkSettings:
        return LinkSettings(mode="client", connect=(self.endpoint,))

    async def start(self, *under: str, **environment: str) -> None:
        """Begin, ``under`` a program that takes rights away."""
        command = [*under, sys.executable, "-m", "cellwatt.commands", "run", str(self.file)]
        with (self.folder / "daemon.log").open("ab") as log:
            self.process = await asyncio.create_subprocess_exec(
                *command, stderr=log, env={**os.environ, **environment}, start_new_session=True
            )

    async def stop(self) -> int:
        """SIGTERM; the exit code."""
        assert self.process is not None
        if self.process.returncode is None:
            self.process.send_signal(signal.SIGTERM)
        return await asyncio.wait_for(self.process.wait(), PATIENCE)

    async def kill(self) -> None:
        """SIGKILL to all its processes, as systemd does where the first of them dies."""
        assert self.process is not None
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.process.pid, signal.SIGKILL)
        await self.process.wait()

    def hang_up(self) -> None:
        """SIGHUP: reload."""
        assert self.process is not None
        self.process.send_signal(signal.SIGHUP)

    async def __aenter__(self) -> Daemon:
        await self.start()
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.kill()
        if error is not None:
            error.add_note(f"daemon's log:\n{self.log[-4000:]}")


class Audience:
    """Everything a subscriber got, with conditions to wait for."""

    def __init__(self, daemon: Daemon, topics: tuple[str, ...] = EVERYTHING) -> None:
        self._daemon = daemon
        self._topics = topics
        self.batches: defaultdict[str, list[Batch]] = defaultdict(list)
        self.frames: list[Frames] = []
        self.results: defaultdict[str, list[Any]] = defaultdict(list)
        self.events: list[Event] = []
        self.gaps: list[Gap] = []
        self.status: dict[str, Any] = {}
        self.unbalanced: list[tuple[str, dict[str, Any]]] = []
        self.received: Counter[str] = Counter()
        self._changed = asyncio.Event()

    async def __aenter__(self) -> Audience:
        await eventually(self._open, "the daemon's endpoint")
        self._task = asyncio.create_task(self._listen())
        return self

    async def _open(self) -> bool:
        """Whether the daemon is up so far that it takes a subscriber."""
        assert self._daemon.process is None or self._daemon.process.returncode is None, "the daemon has ended"
        self._subscriber = Subscriber("test", "test", self._daemon.link, want=self._topics)
        try:
            await self._subscriber.__aenter__()
        except OutletError:
            return False
        return True

    async def __aexit__(self, *_: object) -> None:
        self._task.cancel()
        await asyncio.gather(self._task, return_exceptions=True)
        await self._subscriber.__aexit__(None, None, None)

    async def _listen(self) -> None:
        async for message in self._subscriber:
            content = message.content
            if isinstance(content, Batch):
                self.batches[message.topic].append(content)
                self.received[message.topic] += len(content)
            elif isinstance(content, Frames):
                self.frames.append(content)
                self.received["frame"] += len(content)
            elif isinstance(content, Health):
                self.status = dict(content.status)
                sources = self.status["sources"].items()
                self.unbalanced += [(name, s) for name, s in sources if s["residue"] or not balanced(s)]
            elif isinstance(content, Gap):
                self.gaps.append(content)
            elif isinstance(content, Event):
                self.events.append(content)
            else:
                self.results[message.topic.split("/")[0]].append(content)
            self._changed.set()

    async def until(self, condition: Callable[[Audience], Any], seconds: float = PATIENCE) -> None:
        """Wait until the condition holds; fails with what was last seen."""
        end = time.monotonic() + seconds
        while not condition(self):
            left = end - time.monotonic()
            if left <= 0:
                raise AssertionError(f"did not happen within {seconds} s; last health: {self.status}")
            self._changed.clear()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._changed.wait(), left)

    def source(self, name: str) -> dict[str, Any]:
        source: dict[str, Any] = self.status.get("sources", {}).get(name, {})
        return source

    def all_up(self) -> bool:
        """Whether every source delivers."""
        sources = self.status.get("sources", {})
        return bool(sources) and all(s["state"] == "ok" and s["received"] for s in sources.values())

    @property
    def alarms(self) -> list[Alarm]:
        return self.results["alarm"]


def ur(name: str, address: str, **settings: str) -> str:
    host, port = address.split(":")
    more = "".join(f", {k}: {v}" for k, v in settings.items())
    return f"  {name}: {{driver: ur, host: {host}, port: {port}{more}}}\n"


@contextlib.asynccontextmanager
async def judged_arm(epoch: float) -> AsyncIterator[tuple[tuple[EmulatorProcess, EmulatorProcess], str]]:
    """An arm and the meter of its supply, and the settings of a cell that judges its joints."""
    common = ("--epoch", str(epoch))
    async with (
        EmulatorProcess("ur", "--listen", "127.0.0.1:0", *common) as arm,
        EmulatorProcess("power_board", "--listen", "pty", *common) as board,
    ):
        yield (
            (arm, board),
            f"""
sources:
{ur("arm", arm.address)}  board: {{driver: power_board, port: {board.address}, rate: 123 Hz}}
stages:
  segment: {{arm: arm}}
  faults: {{stage: faults, reference: {REFERENCE}, arm: arm, power: board.supply.power}}
""",
        )


async def hook_spring(devices: Iterable[EmulatorProcess], epoch: float, seconds: float) -> None:
    """A spring on the elbow at the first standstill that is at least so far ahead."""
    hooked = next_start(time.time() + seconds, epoch)
    for device in devices:
        await device.strike(spring(hooked - epoch))


@contextlib.asynccontextmanager
async def running(folder: Path, text: str) -> AsyncIterator[tuple[Daemon, Audience]]:
    """A daemon and its audience."""
    async with Daemon(folder, text) as daemon, Audience(daemon) as audience:
        yield daemon, audience


async def cellwatt(*words: str) -> tuple[int | None, str, str]:
    """A command of ours, run to its end: its exit code and what it printed."""
    pipe = asyncio.subprocess.PIPE
    command = [sys.executable, "-m", "cellwatt.commands", *words]
    process = await asyncio.create_subprocess_exec(*command, stdout=pipe, stderr=pipe)
    out, err = await process.communicate()
    return process.returncode, out.decode(), err.decode()


def numbers(blocks: Iterable[Batch | Frames]) -> np.ndarray:
    """Numbers of all samples or frames, in the order in which they came."""
    return np.concatenate([block.sequence + np.arange(len(block)) for block in blocks])


def balanced(source: dict[str, Any]) -> bool:
    """expected = received + missed + dropped."""
    lost = sum(source["missed"].values()) + sum(source["dropped"].values())
    return bool(source["expected"] == source["received"] + lost)
