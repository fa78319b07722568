"""A driver shares its event loop with all other devices of the cell."""

from __future__ import annotations

import asyncio
import sys
import threading
import time
import traceback
from pathlib import Path

from cellwatt.testing.device import EmulatedDevice
from cellwatt.testing.inlet import CollectingInlet
from cellwatt.testing.rig import Rig, require
from cellwatt.testing.running import running

LONGEST = 0.5
"""Longest time for which the loop may be blocked, s; a busy machine alone stays far below."""
_BEAT = 0.01


async def keeps_the_loop_free(rig: Rig, folder: Path) -> None:
    """Require that no call blocks the loop, even while the device does not answer."""
    async with EmulatedDevice(rig, folder) as device:
        # The first instance imports its libraries: a daemon does so before it reads any device.
        await asyncio.to_thread(rig.make, device.address, CollectingInlet())
        watch = Watch()
        beating = asyncio.create_task(watch.beat())
        try:
            async with running(rig, device.address) as source:
                await source.samples(10, "after the start")
                if "stall" in rig.emulator.faults:
                    await device.inject(rig.fault("stall"))
                await source.samples(10, "after a stall")
            await device.switch_off()
            async with running(rig, device.address) as source:
                await source.until(lambda: source.failures, "a SourceError while the device is off")
        finally:
            await asyncio.to_thread(watch.stop)
            beating.cancel()
            await asyncio.wait([beating])
    require(not watch.culprit, f"the event loop stood still for more than {LONGEST:g} s, in:\n{watch.culprit}")


class Watch:
    """Stores the stack of a call that blocks its creator's loop as ``culprit``; empty without one."""

    def __init__(self) -> None:
        self.culprit = ""
        self._watched = threading.get_ident()
        self._last = time.monotonic()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    async def beat(self) -> None:
        """Record that the loop is running, until cancelled."""
        while True:
            self._last = time.monotonic()
            await asyncio.sleep(_BEAT)

    def stop(self) -> None:
        """Stop watching."""
        self._over.set()
        self._thread.join()

    def _look(self) -> None:
        while not self._over.wait(_BEAT):
            if time.monotonic() - self._last > LONGEST and not self.culprit:
                frame = sys._current_frames().get(self._watched)
                self.culprit = "".join(traceback.format_stack(frame)[-4:]) if frame else "unknown"
