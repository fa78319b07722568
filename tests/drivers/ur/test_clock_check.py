"""The clock's bound holds the truth whatever the order in which a controller answers and sends."""

from __future__ import annotations

import asyncio
import math
import random
import time
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager

import numpy as np
import pytest

from cellwatt import Batch
from cellwatt.emulation import ArmSignals
from cellwatt.errors import ProtocolError
from cellwatt.runtime.source import Source
from cellwatt_drivers.ur import UrDriver, clock_check
from cellwatt_drivers.ur.emulated_client import EmulatedClient
from cellwatt_drivers.ur.emulated_samples import BOOTED
from cellwatt_drivers.ur.emulator import UrEmulator
from tests.doing import doing
from tests.patience import eventually

from ..running import endpoint, served

RATE = 500.0


class EarlyAnswers(UrEmulator):
    """A controller that answers at once, and whose packages lie in a queue for as long as ``lie`` says, in order."""

    def __init__(self, lie: Callable[[], float]) -> None:
        super().__init__(ArmSignals(), "127.0.0.1:0")
        self.lie = lie
        self._free: dict[EmulatedClient, float] = {}

    def _send(self, client: EmulatedClient, packages: list[bytes]) -> None:
        if packages:
            loop = asyncio.get_running_loop()
            at = self._free[client] = max(self._free.get(client, 0.0) + 1e-5, loop.time() + self.lie())
            loop.call_at(at, super()._send, client, packages.copy())
            packages.clear()

    def made(self, device_time: np.ndarray) -> np.ndarray:
        """When packages were made, UTC ns, by this process's own clocks."""
        began = round(self._began * 1e9) + time.time_ns() - time.monotonic_ns()
        return began + device_time - round(BOOTED * 1e9)


def sometimes() -> Callable[[], float]:
    chance = random.Random(7)
    return lambda: 0.385 if chance.random() < 0.01 else 0.0


@asynccontextmanager
async def read(emulator: UrEmulator, batches: list[Batch]) -> AsyncIterator[Source]:
    async with served(emulator) as address:
        chosen = UrDriver.Settings(**endpoint(address), rate="500 Hz", channels=["actual_q"])
        made = Source("arm", UrDriver, chosen, time.time_ns, batches.append, lambda _: None)
        async with doing(made.run()):  # ended before the arm: else a connection that is just being made has no end
            yield made


async def test_the_bound_holds_where_answers_come_before_older_packages(monkeypatch):
    monkeypatch.setattr(clock_check, "USUAL", 1.0)
    emulator = EarlyAnswers(sometimes())
    batches: list[Batch] = []
    async with read(emulator, batches) as source:
        await eventually(lambda: source.account.received > 6 * RATE)
    device_time, stamped, bound = (
        np.concatenate([getattr(b, name) for b in batches]) for name in ("device_time", "time", "bound")
    )
    wrong = np.abs(stamped - emulator.made(device_time)) - bound
    print("bound, ms: p50", np.median(bound[1000:]) / 1e6, "p99", np.percentile(bound[1000:], 99) / 1e6)
    assert wrong.max() <= 200_000, "ns; the two clocks of this process may be read so far apart"
    assert source.clocks["rtde"].resets == 0
    assert source.account.counters["event clock_reset"] == source.account.counters["event clock_step"] == 0
    assert bound[-1] < 0.4e9, "half of what the packages lie, at most, and some ms"


async def test_a_controller_that_takes_no_second_connection_is_read_all_the_same(monkeypatch):
    monkeypatch.setattr(clock_check, "FIRST", 0.05)
    emulator = EarlyAnswers(lambda: 0.0)
    async with read(emulator, []) as source:
        await eventually(lambda: source.account.received > 0)
        monkeypatch.setattr(EmulatedClient, "_answer", lambda client, *_: client.abort())
        await eventually(lambda: source.account.counters["clock comparisons failed"] >= 2)
        seen = source.account.received
        await eventually(lambda: source.account.received > seen + 100)
    assert source.account.counters["restarts"] == 0


async def test_a_controller_time_that_is_none_ends_a_comparison():
    emulator = UrEmulator(ArmSignals(), "127.0.0.1:0")
    async with served(emulator) as address:
        emulator._shift = math.nan
        with pytest.raises(ProtocolError, match="controller time nan"):
            await clock_check._first_package("127.0.0.1", int(address.rpartition(":")[2]), RATE, 20.0, time.time_ns)
