"""An emulator in its own process, controlled by JSON lines.

To the emulator: ``{"fault": "loss:probability=1%"}``, ``{"counts": true}``, ``{"kept": true}``; end of input ends the
process.
From it: ``{"ready": address}`` once, then one answer a line: ``{"ok": true}``, ``{"counts": {...}}``,
``{"kept": s}`` or ``{"error": text}``.
"""

from __future__ import annotations

import asyncio
import contextlib
import json
import os
from collections.abc import Mapping, Sequence
from typing import Any

from cellwatt.child import MODULE, ended, ends_with_parent
from cellwatt.errors import CellwattError

_PRIORITY = 5
"""Real-time priority, below the daemon's own."""
ANSWER = 60.0
"""Longest time, s, for an answer, including the first one after the start."""


class EmulatorProcess:
    """``cellwatt emulate DRIVER …`` as a child; use as an async context manager.

    ``arguments`` follow the driver's name on the command line. ``address`` is set inside the context.
    Raises ``CellwattError`` if the child does not start or answers with an error.
    """

    def __init__(self, driver: str, *arguments: str) -> None:
        self.driver = driver
        self._arguments: Sequence[str] = arguments
        self._child: asyncio.subprocess.Process | None = None
        self._talking = asyncio.Lock()
        self._unread = 0
        """Answers due from the child: more than one after a call that was cancelled, or that timed out."""
        self.address = ""

    async def __aenter__(self) -> EmulatorProcess:
        command = [*MODULE, "cellwatt.commands", "emulate", self.driver, "--control", *self._arguments]
        self._child = await asyncio.create_subprocess_exec(
            *command,
            stdin=asyncio.subprocess.PIPE,
            stdout=asyncio.subprocess.PIPE,
            preexec_fn=ends_with_parent(),
        )
        try:
            answer = await self._read()
            if "ready" not in answer:
                raise CellwattError(f"the {self.driver} emulator did not start: {answer.get('error', answer)}")
        except BaseException:
            await self._end()
            raise
        self.address = str(answer["ready"])
        return self

    async def __aexit__(self, *_: object) -> None:
        await self._end()

    @property
    def pid(self) -> int:
        """Process id of the child, inside the context."""
        assert self._child is not None
        return self._child.pid

    def be_punctual(self) -> None:
        """Use real-time scheduling, if permitted: a real device does not wait for other work of this PC."""
        with contextlib.suppress(OSError):
            os.sched_setscheduler(self.pid, os.SCHED_RR, os.sched_param(_PRIORITY))

    async def strike(self, fault: str) -> None:
        """Begin a fault, or change the device or its world, in the words of ``cellwatt.emulation.words``."""
        await self.ask({"fault": fault})

    async def counts(self) -> Mapping[str, int]:
        """Numbers of samples sent and faults injected so far."""
        return dict((await self.ask({"counts": True}))["counts"])

    async def kept(self) -> float:
        """Time, s, for which other programs of this PC delayed the child since the last call, or since its start."""
        return float((await self.ask({"kept": True}))["kept"])

    async def ended(self) -> int:
        """Wait for the child to end; return its exit code."""
        assert self._child is not None
        return await self._child.wait()

    async def ask(self, message: Mapping[str, Any]) -> Mapping[str, Any]:
        """Send a command to the child, and return its answer. Raises ``CellwattError`` if the answer is an error."""
        child = self._child
        if child is None or child.stdin is None:
            raise CellwattError(f"the {self.driver} emulator is not running")
        async with self._talking:
            child.stdin.write(json.dumps(message).encode() + b"\n")
            self._unread += 1
            await child.stdin.drain()
            while self._unread:
                answer = await self._read()
                self._unread -= 1
        if "error" in answer:
            raise CellwattError(f"{self.driver} emulator: {answer['error']}")
        return answer

    async def _read(self) -> dict[str, Any]:
        assert self._child is not None and self._child.stdout is not None
        try:
            async with asyncio.timeout(ANSWER):
                line = await self._child.stdout.readline()
        except TimeoutError:
            raise CellwattError(f"the {self.driver} emulator did not answer for {ANSWER:.0f} s") from None
        if not line:
            return {"error": f"ended with exit code {await self._child.wait()}"}
        answer: dict[str, Any] = json.loads(line)
        return answer

    async def _end(self) -> None:
        child, self._child = self._child, None
        self._unread = 0
        if child is None:
            return
        if child.stdin is not None:
            child.stdin.close()
        await ended(child, 5.0)
