"""Runs a driver's emulator on its own loop and thread, so that a blocking driver does not stop it."""

from __future__ import annotations

import asyncio
import contextlib
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from pathlib import Path
from typing import TypeVar

from cellwatt.emulation import ArmSignals, Emulator, Fault, Signals
from cellwatt.testing.rig import NotConformingError, Rig

T = TypeVar("T")

_TURN = 2.0
"""Longest time for one turn of the emulator's loop, s."""
_LAST_TURNS = 3
"""Turns of the emulator's loop until connections accepted just before its end are closed."""


class EmulatedDevice:
    """The emulated device, an async context manager; the device is on inside the context.

    It measures ``signals`` (default: the emulated arm). ``folder`` holds the link to its serial port, if it has one.
    """

    def __init__(self, rig: Rig, folder: Path, signals: Signals | None = None) -> None:
        self._rig = rig
        self._folder = folder
        self._signals = ArmSignals() if signals is None else signals
        self._thread: threading.Thread | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._serving: asyncio.Task[None] | None = None
        self._emulator: Emulator | None = None
        self._failure: NotConformingError | None = None
        self.address = ""
        """Address at which it listens; unchanged while it is off."""

    async def __aenter__(self) -> EmulatedDevice:
        await self.switch_on()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.switch_off()

    async def switch_on(self) -> None:
        """Start the emulator, always at the same address. Raises ``NotConformingError`` if it does not start."""
        ready: Future[str] = Future()
        at = str(self._folder / "device") if self._rig.address == "pty" else self.address or self._rig.address
        self._emulator = self._rig.emulator(self._signals, at, seed=1, options=self._rig.options)
        self._thread = threading.Thread(target=self._run, args=(self._emulator, ready), name="emulator", daemon=True)
        self._thread.start()
        try:
            async with asyncio.timeout(self._rig.patience):
                self.address = await asyncio.wrap_future(ready)
        except TimeoutError:
            raise NotConformingError(f"{self._emulator.title}: never called ready(address)") from None

    async def switch_off(self) -> None:
        """Stop the emulator: its connections end and its port is freed."""
        thread, self._thread = self._thread, None
        if thread is None or self._loop is None or self._serving is None:
            return
        if thread.is_alive():
            # Run one turn of its loop first: asyncio forgets a connection that is accepted just as its server closes.
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_TURN):
                    await self._ask(lambda _: None)
            with contextlib.suppress(RuntimeError):  # the loop has ended in the meantime
                self._loop.call_soon_threadsafe(self._serving.cancel)
        await asyncio.to_thread(thread.join, self._rig.patience)
        if thread.is_alive():
            raise NotConformingError("the emulator's serve() does not end when it is cancelled")
        if self._failure is not None:
            raise self._failure

    async def inject(self, fault: Fault) -> None:
        """Begin a fault."""
        await self._ask(lambda emulator: emulator.inject(fault))

    async def counts(self) -> Mapping[str, int]:
        """Numbers of samples sent and faults injected since it was switched on."""
        return await self._ask(lambda emulator: dict(emulator.counts))

    async def _ask(self, question: Callable[[Emulator], T]) -> T:
        async def answer() -> T:
            assert self._emulator is not None
            return question(self._emulator)

        assert self._loop is not None
        return await asyncio.wrap_future(asyncio.run_coroutine_threadsafe(answer(), self._loop))

    def _run(self, emulator: Emulator, ready: Future[str]) -> None:
        async def serve() -> None:
            self._loop = asyncio.get_running_loop()
            self._serving = asyncio.ensure_future(emulator.serve(ready.set_result))
            with contextlib.suppress(asyncio.CancelledError):
                await self._serving
            for _ in range(_LAST_TURNS):
                await asyncio.sleep(0)

        try:
            asyncio.run(serve())
        except Exception as error:
            self._failure = NotConformingError(f"{emulator.title}: serve() failed: {type(error).__name__}: {error}")
            if not ready.done():
                ready.set_exception(self._failure)
