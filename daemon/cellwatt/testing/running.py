"""Runs a driver as the daemon does."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from typing import Any

from cellwatt.driver import Driver
from cellwatt.errors import SourceError
from cellwatt.testing.inlet import CollectingInlet
from cellwatt.testing.rig import NotConformingError, Rig, require

_PAUSE = 0.05
"""s between a failure and the next run."""


@dataclass
class Running:
    """A running driver, its output, and the ``SourceError`` of each failed run."""

    rig: Rig
    driver: Driver[Any]
    inlet: CollectingInlet
    failures: list[SourceError] = field(default_factory=list)
    task: asyncio.Task[None] = field(init=False)

    def start(self) -> None:
        """Run the driver."""
        self.task = asyncio.create_task(self.supervise())

    async def until(self, condition: Callable[[], object], what: str) -> None:
        """Wait for a condition. Raises ``NotConformingError`` if it is not met in time or the driver broke."""
        try:
            await self.inlet.until(lambda: condition() or self.task.done(), self.rig.patience)
        except TimeoutError:
            raise NotConformingError(
                f"{what}: not within {self.rig.patience:g} s; {self.inlet.samples} samples, "
                f"account {self.inlet.account.snapshot()}, failures {[str(f) for f in self.failures[-3:]]}"
            ) from None
        if self.task.done():
            self.verdict()

    async def samples(self, more: int, when: str) -> None:
        """Wait for ``more`` samples."""
        goal = self.inlet.samples + more
        await self.until(lambda: self.inlet.samples >= goal, f"{more} samples {when}")

    def verdict(self) -> None:
        """Raise ``NotConformingError`` if ``run`` ended in a forbidden way or the account does not balance."""
        task = self.task
        if task.done() and not task.cancelled():
            error = task.exception()
            if error is None:
                raise NotConformingError("run() returned: it must run until it is cancelled, or raise SourceError")
            raise NotConformingError(
                f"run() raised {type(error).__name__}: {error}; map what a library or the system raises to a "
                "SourceError (ConnectError, ProtocolError, DeviceError, WrongDeviceError)"
            ) from error
        uneven = [r for r in self.inlet.residues if r]
        seen = f"after {len(uneven)} of {len(self.inlet.residues)} readings it was {uneven[:3]}, " if uneven else ""
        require(
            not uneven and self.inlet.account.residue == 0,
            f"expected = received + missed + dropped does not hold whenever the loop turns: {seen}now "
            f"{self.inlet.account.snapshot()}; call account.expect() for each sample due, at the moment at which it "
            "is emitted, or missed (account.miss) because it never came",
        )
        require(
            not self.inlet.early,
            f"{self.inlet.early} readings arrived before inlet.connected(identity): call it first in each run()",
        )

    async def supervise(self) -> None:
        """Run the driver, and again after each ``SourceError``."""
        while True:
            self.inlet.begin()
            try:
                await self.driver.run()
            except SourceError as error:
                self.failures.append(error)
                await asyncio.sleep(_PAUSE)
            else:
                return


async def ended(task: asyncio.Task[Any], patience: float) -> None:
    """Cancel a task and wait for its end. Raises ``NotConformingError`` if it does not end as cancelled."""
    task.cancel()
    _, pending = await asyncio.wait([task], timeout=patience)
    if pending:
        raise NotConformingError(f"run() was cancelled and still runs after {patience:g} s")
    if not task.cancelled():
        error = task.exception()
        how = "returned" if error is None else f"raised {type(error).__name__}: {error}"
        raise NotConformingError(f"run() was cancelled and {how}: let asyncio.CancelledError pass")


@asynccontextmanager
async def running(rig: Rig, address: str) -> AsyncIterator[Running]:
    """Run a driver, again after each failure, until the end of the context; then check the outcome."""
    inlet = CollectingInlet()
    found = Running(rig, rig.make(address, inlet), inlet)
    found.start()
    try:
        yield found
    except BaseException:
        found.task.cancel()
        await asyncio.wait([found.task], timeout=rig.patience)
        raise
    if not found.task.done():
        await ended(found.task, rig.patience)
        await asyncio.sleep(0)
    found.verdict()
