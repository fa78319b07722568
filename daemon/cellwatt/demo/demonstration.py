"""One run of the demo: starts all processes, waits, and stops them in order."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from cellwatt.config import load
from cellwatt.demo import cells, fault, processes, simulation
from cellwatt.demo.seen import Seen
from cellwatt.demo.summary import delivery_problems, sources_of, summary
from cellwatt.emulation import EmulatorProcess
from cellwatt.emulation.cell import devices_of, places, running
from cellwatt.errors import CellwattError

HEALTHY = 20.0
"""Longest time, s, before the spring is attached, and shortest run: it includes healthy cycles before the fault."""
COMPARED = 17.0
"""Time, s, after the spring is attached until the arm is compared with its simulation: two cycles of its task."""
SHORTEST = 12.0
"""Shortest recording, s, that is compared with the simulation."""
STOP = 60.0
"""Longest time, s, that the daemon may take to drain, and then the last messages to the subscriber."""


@dataclass
class Demonstration:
    """One run. ``show`` is called with each message of the subscriber, ``say`` with a text for each step."""

    folder: Path
    seconds: float
    show: Callable[[Mapping[str, Any]], None]
    say: Callable[[str], None]
    seen: Seen = field(default_factory=Seen)
    epoch: float = field(default_factory=time.time)
    """UTC s at which the emulated arms start."""
    _stopped: str = ""
    _stopping: asyncio.Event = field(default_factory=asyncio.Event)

    def stop(self, why: str) -> None:
        """End the run early; the summary contains ``why`` and the results up to then."""
        self._stopped = self._stopped or why
        self._stopping.set()

    async def run(self) -> dict[str, Any]:
        """Run four devices and attach a spring to an elbow joint; return the summary, ready for JSON.

        Raises ``CellwattError`` if a process does not start.
        """
        endpoint, page = cells.free_endpoint(), cells.free_endpoint()
        self.say(f"the daemon and four emulated devices are starting; then in a browser: http://{page}")
        file = cells.packaged()
        config = load(file, cells.environment(self.folder, endpoint, page, {}))
        devices = [replace(d, speed=cells.SPEEDS.get(d.name, 1.0)) for d in devices_of(config, free=True)]
        async with running(devices, self.epoch) as emulators:
            variables = cells.environment(self.folder, endpoint, page, places(devices, emulators))
            async with processes.daemon(file, self.folder, variables) as daemon:
                hooked = await self._follow(daemon, endpoint, emulators, page)
            delays = {name: await emulator.kept() for name, emulator in emulators.items()}
        found = summary(self.seen, delays, hooked, daemon.returncode)
        if not self._stopped:
            return found
        return {**found, "ok": False, "problems": [f"the demo was ended early: {self._stopped}", *found["problems"]]}

    async def _pause(self, seconds: float) -> None:
        """Sleep; return early if the demo is stopped."""
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._stopping.wait(), max(0.0, seconds))

    async def _follow(
        self,
        daemon: asyncio.subprocess.Process,
        endpoint: str,
        emulators: Mapping[str, EmulatorProcess],
        page: str,
    ) -> float | None:
        """Run the subscriber and attach the spring, then stop daemon and subscriber; return as ``_hook``."""
        async with processes.subscriber(endpoint) as watching:
            reading = asyncio.create_task(self._read(watching))
            try:
                await self._until_running(daemon, watching)
                hooked = await self._hook(emulators, page)
                daemon.send_signal(signal.SIGTERM)
                await asyncio.wait_for(daemon.wait(), STOP)
                await self._until_delivered()
            finally:
                with contextlib.suppress(ProcessLookupError):
                    watching.terminate()
                await asyncio.wait([reading], timeout=5)
                reading.cancel()
            return hooked

    async def _hook(self, emulators: Mapping[str, EmulatorProcess], page: str) -> float | None:
        """Attach the spring, at the latest halfway; return the UTC time, s, or None if the demo ended before."""
        look = f"in a browser: http://{page}"
        healthy = min(self.seconds / 2, HEALTHY)
        self.say(f"running for {self.seconds:.0f} s; the spring comes after {healthy:.0f} s; {look}")
        start = time.time()
        hooked = fault.next_start(start + healthy, self.epoch)
        comparing = [asyncio.create_task(self._compare("healthy", start, hooked - 1, look))]
        try:
            await self._pause(hooked - 0.5 - time.time())
            if self._stopped:
                return None
            for name in fault.FAULTY:
                await emulators[name].strike(fault.spring(hooked - self.epoch))
            self.say(f"a spring is attached to joint {fault.JOINT} of {fault.FAULTY[0]}; {look}")
            sprung = self._compare("with-the-spring", hooked + 1, hooked + COMPARED, look)
            comparing.append(asyncio.create_task(sprung))
            await self._pause(start + self.seconds - time.time())
        finally:
            await _ended(comparing)
        return hooked

    async def _compare(self, name: str, since: float, until: float, look: str) -> None:
        """Wait until the UTC time ``until``, compare the arm with its simulation, and report the findings."""
        await self._pause(until - time.time())
        if self._stopped or until - since < SHORTEST:
            return
        try:
            self.say(f"simulation: {await simulation.compared(self.folder, name, self.epoch, since, until)} {look}")
        except CellwattError as error:
            self.say(f"simulation: not compared: {error}")

    async def _until_running(self, daemon: asyncio.subprocess.Process, watching: asyncio.subprocess.Process) -> None:
        end = time.monotonic() + processes.START
        while time.monotonic() < end:
            if not self.seen.not_up():
                return
            for name, process in (("daemon", daemon), ("subscriber", watching)):
                if process.returncode is not None:
                    raise CellwattError(f"the {name} ended with exit code {process.returncode}{self._last_words()}")
            if self._stopped:
                raise CellwattError(f"the demo was ended before everything ran: {self._stopped}")
            await asyncio.sleep(0.05)
        raise CellwattError(f"not all sources ran within {processes.START:.0f} s: {'; '.join(self.seen.not_up())}")

    async def _until_delivered(self) -> None:
        """Wait for messages in transit to the subscriber; the summary reports those that never arrive."""
        end = time.monotonic() + STOP
        while time.monotonic() < end:
            if not delivery_problems(self.seen, sources_of(self.seen, {})):
                return
            await asyncio.sleep(0.05)

    def _last_words(self) -> str:
        lines = processes.log_of(self.folder).read_text(errors="replace").strip().splitlines()
        return f": {lines[-1]}" if lines else ""

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        assert process.stdout is not None
        while line := await process.stdout.readline():
            message = json.loads(line)
            self.seen.add(message)
            self.show(message)


async def _ended(tasks: Sequence[asyncio.Task[None]]) -> None:
    """Cancel the tasks that are still running. Re-raises an exception of a task."""
    for task in tasks:
        task.cancel()
    for result in await asyncio.gather(*tasks, return_exceptions=True):
        if isinstance(result, Exception):
            raise result
