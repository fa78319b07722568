"""One run of the demo: start everything, wait, stop it in order."""

from __future__ import annotations

import asyncio
import contextlib
import json
import signal
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cellwatt.demo import cells, fault, processes
from cellwatt.demo.cells import Device
from cellwatt.demo.power import power_of
from cellwatt.demo.seen import Seen
from cellwatt.demo.summary import delivery_problems, sources_of, summary, summary_of_every_driver
from cellwatt.emulation import EmulatorProcess
from cellwatt.errors import CellwattError

START = 60.0
"""Longest time, s, until everything runs."""
STOP = 60.0
"""Longest time, s, that the daemon may take to drain, and then the last messages to the subscriber."""


@dataclass
class Demonstration:
    """One run. ``show`` is called with each line of the subscriber, ``say`` with each step of the demo."""

    folder: Path
    seconds: float
    show: Callable[[Mapping[str, Any]], None]
    say: Callable[[str], None]
    seen: Seen = field(default_factory=Seen)
    epoch: float = field(default_factory=time.time)
    """UTC s at which the emulated arms start."""

    async def small(self) -> dict[str, Any]:
        """Run four devices and hook a spring on an elbow halfway; return the summary, JSON-ready.

        Raises ``CellwattError`` when a process does not start.
        """
        endpoint = cells.free_endpoint()
        async with contextlib.AsyncExitStack() as stack:
            emulators = await self._emulators(stack, cells.SMALL)
            told = cells.environment(self.folder, {name: e.address for name, e in emulators.items()}, endpoint)
            running = processes.daemon(cells.packaged(), self.folder, told)
            hooked = 0.0

            async def play() -> None:
                nonlocal hooked
                hooked = await self._hook(emulators)

            code = await self._follow(running, endpoint, play)
        return summary(self.seen, hooked, code, power_of(self.folder, self.epoch, hooked))

    async def every_driver(self) -> dict[str, Any]:
        """Run a device of each driver; return the summary, JSON-ready. It names drivers whose library is missing.

        Raises ``CellwattError`` when a process does not start.
        """
        endpoint = cells.free_endpoint()
        devices, lacking = cells.usable(cells.every_driver(), self.folder)
        async with contextlib.AsyncExitStack() as stack:
            emulators = await self._emulators(stack, devices)
            addressed = {name: (devices[name], emulator.address) for name, emulator in emulators.items()}
            running = processes.daemon(cells.write(self.folder, addressed, endpoint), self.folder)

            async def play() -> None:
                self.say(f"{len(devices)} devices run for {self.seconds:.0f} s")
                await asyncio.sleep(self.seconds)

            code = await self._follow(running, endpoint, play)
            sent = {name: dict(await emulator.counts()) for name, emulator in emulators.items()}
        return summary_of_every_driver(self.seen, devices, lacking, sent, code)

    async def _emulators(
        self, stack: contextlib.AsyncExitStack, devices: Mapping[str, Device]
    ) -> dict[str, EmulatorProcess]:
        """Start all emulators at once; raise a failure after all have started or failed, so that none keeps running."""
        made = {
            name: EmulatorProcess(device.driver, *device.arguments(self.epoch, seed))
            for seed, (name, device) in enumerate(devices.items())
        }
        entering = (stack.enter_async_context(emulator) for emulator in made.values())
        for outcome in await asyncio.gather(*entering, return_exceptions=True):
            if isinstance(outcome, BaseException):
                raise outcome
        for emulator in made.values():
            emulator.be_punctual()
        return made

    async def _follow(
        self,
        running: contextlib.AbstractAsyncContextManager[asyncio.subprocess.Process],
        endpoint: str,
        play: Callable[[], Any],
    ) -> int | None:
        """Run daemon and subscriber for the demo's duration, then end both; return the daemon's exit code."""
        async with running as daemon, processes.subscriber(endpoint) as watching:
            reading = asyncio.create_task(self._read(watching))
            try:
                await self._until_running(daemon, watching)
                await play()
                daemon.send_signal(signal.SIGTERM)
                await asyncio.wait_for(daemon.wait(), STOP)
                await self._until_delivered()
            finally:
                with contextlib.suppress(ProcessLookupError):
                    watching.terminate()
                await asyncio.wait([reading], timeout=5)
                reading.cancel()
            return daemon.returncode

    async def _hook(self, emulators: Mapping[str, EmulatorProcess]) -> float:
        """Hook the spring on halfway; return the UTC time of it, s."""
        self.say(f"running for {self.seconds:.0f} s; the spring comes halfway")
        start = time.time()
        hooked = fault.next_start(start + self.seconds / 2, self.epoch)
        await asyncio.sleep(hooked - 0.5 - time.time())
        for name in fault.FAULTY:
            await emulators[name].disturb(spring=float(fault.JOINT), at=hooked - self.epoch, **fault.SPRING)
        self.say(f"a spring is hooked on joint {fault.JOINT} of {fault.FAULTY[0]}")
        await asyncio.sleep(max(0.0, start + self.seconds - time.time()))
        return hooked

    async def _until_running(self, daemon: asyncio.subprocess.Process, watching: asyncio.subprocess.Process) -> None:
        end = time.monotonic() + START
        while time.monotonic() < end:
            if self.seen.all_up():
                return
            for name, process in (("daemon", daemon), ("subscriber", watching)):
                if process.returncode is not None:
                    raise CellwattError(f"the {name} ended with exit code {process.returncode}{self._last_words()}")
            await asyncio.sleep(0.05)
        raise CellwattError(f"not everything ran within {START:.0f} s: {json.dumps(self.seen.status)[:400]}")

    async def _until_delivered(self) -> None:
        """Wait for messages still on their way to the subscriber; the summary reports those that never arrive."""
        end = time.monotonic() + STOP
        while time.monotonic() < end:
            if not delivery_problems(self.seen, sources_of(self.seen)):
                return
            await asyncio.sleep(0.05)

    def _last_words(self) -> str:
        said = processes.log_of(self.folder).read_text(errors="replace").strip().splitlines()
        return f": {said[-1]}" if said else ""

    async def _read(self, process: asyncio.subprocess.Process) -> None:
        assert process.stdout is not None
        while line := await process.stdout.readline():
            message = json.loads(line)
            self.seen.add(message)
            self.show(message)
