"""An emulator and a driver on one loop, and a world that stands still."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import AbstractAsyncContextManager, asynccontextmanager
from dataclasses import dataclass, field
from typing import Any, Generic, TypeVar

from cellwatt.driver import Driver
from cellwatt.emulation import Emulator, Fault
from cellwatt.errors import SourceError
from cellwatt.testing.checks.stamps import times_are_right
from cellwatt.testing.checks.values import StandingSignals as Steady
from tests.doing import doing
from tests.patience import eventually

from .inlet import CollectingInlet

__all__ = ["Run", "Served", "Steady", "endpoint", "once", "repeated", "served", "strike", "with_address"]

D = TypeVar("D", bound=Driver[Any])
E = TypeVar("E", bound=Emulator)
Served = AbstractAsyncContextManager[tuple[E, str]]
"""Of an emulator and its address."""


def endpoint(address: str) -> dict[str, Any]:
    """The settings of a driver that reads a device at ``HOST:PORT``."""
    host, _, port = address.rpartition(":")
    return {"host": host, "port": int(port)}


@asynccontextmanager
async def served(emulator: Emulator) -> AsyncIterator[str]:
    """An emulator that serves; its address."""
    ready: asyncio.Future[str] = asyncio.get_running_loop().create_future()
    async with doing(emulator.serve(ready.set_result)) as serving:
        await asyncio.wait((serving, ready), return_when=asyncio.FIRST_COMPLETED)
        if serving.done():
            serving.result()
        yield await ready


@asynccontextmanager
async def with_address(emulator: E) -> AsyncIterator[tuple[E, str]]:
    """An emulator that serves, and its address."""
    async with served(emulator) as address:
        yield emulator, address


@dataclass
class Run(Generic[D]):
    """A driver that runs, what it gave and how it failed."""

    driver: D
    inlet: Any
    failures: list[SourceError] = field(default_factory=list)


async def strike(emulator: Any, inlet: CollectingInlet, fault: Fault, times: int = 1) -> None:
    """Let a fault strike, end it, and wait until the driver has gone on for a while."""
    before = emulator.injector.counts[fault.kind]
    emulator.inject(fault)
    await eventually(lambda: emulator.injector.counts[fault.kind] >= before + times, f"the {fault.kind}")
    if fault.kind not in {"stall", "disconnect"}:
        emulator.inject(Fault(fault.kind, probability=0))
    seen = len(inlet.readings)
    await eventually(lambda: len(inlet.readings) > seen + 10)


@asynccontextmanager
async def once(driver: Driver[Any]) -> AsyncIterator[tuple[Any, asyncio.Task[None]]]:
    """A driver running until the end of the context; fails when it failed. Account and times must be right then."""
    async with doing(driver.run()) as task:
        yield driver.inlet, task
    assert_right(driver.inlet)


@asynccontextmanager
async def repeated(driver: D) -> AsyncIterator[Run[D]]:
    """A driver that is run again when it fails, until the end; account and times must be right then."""
    run = Run(driver, driver.inlet)

    async def supervise() -> None:
        while True:
            try:
                await driver.run()
            except SourceError as error:
                run.failures.append(error)
            await asyncio.sleep(0.01)

    async with doing(supervise()):
        yield run
    assert_right(run.inlet)


def assert_right(inlet: Any) -> None:
    """The account is even, and times are as the contract says: no test need look at them again."""
    assert inlet.account.residue == 0
    times_are_right(inlet)
