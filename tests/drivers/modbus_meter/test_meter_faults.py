from __future__ import annotations

import asyncio
from unittest.mock import Mock

import pytest

from cellwatt.emulation import Fault
from cellwatt_drivers.modbus_meter import bus
from cellwatt_drivers.modbus_meter.bus import TcpPlace, open_bus

from ..running import strike
from .rig import emulated, running, settings

PLACES = ["127.0.0.1:0", "pty"]


@pytest.mark.parametrize("address", PLACES)
async def test_lost_answers_are_asked_for_again(address):
    async with emulated(address) as (emulator, place), running(settings(place, timeout="500 ms", retries=3)) as run:
        await run.inlet.until(lambda o: len(o.readings) >= 2)
        await strike(emulator, run.inlet, Fault("loss", probability=0.2), 4)
    assert run.inlet.account.counters["timeouts"] == emulator.counts["loss"]
    assert run.inlet.account.counters["retries"] + run.inlet.account.missed["timeout"] == emulator.counts["loss"]


@pytest.mark.parametrize("kind", ["half_frame", "garbage", "delay"])
@pytest.mark.parametrize("address", PLACES)
async def test_damaged_and_late_answers_never_become_values(address, kind):
    async with (
        emulated(address) as (emulator, place),
        running(settings(place, timeout="80 ms", silence="20 s")) as run,
    ):
        await run.inlet.until(lambda o: len(o.readings) >= 2)
        await strike(emulator, run.inlet, Fault(kind, probability=0.3, seconds=0.12), 4)
    column = run.driver.streams[0].names.index("supply.power")
    assert run.inlet.values[:, column] == pytest.approx([500.0] * len(run.inlet.values), rel=1e-6)
    assert run.inlet.values[:, 0] == pytest.approx([230.0] * len(run.inlet.values), rel=1e-6)
    account = run.inlet.account
    assert account.counters["timeouts"] + account.counters["malformed"] >= 1


async def test_a_silent_meter_is_given_up():
    async with emulated() as (emulator, place):
        async with running(settings(place, timeout="50 ms", silence="300 ms", retries=0)) as run:
            await run.inlet.until(lambda o: len(o.readings) >= 2)
            emulator.inject(Fault("loss"))
            await run.inlet.until(lambda _: run.failures)
        assert "unit 1 at TCP 127.0.0.1" in str(run.failures[0])
        assert "no answer" in str(run.failures[0])


async def test_a_line_that_was_lost_is_opened_again_once_for_all_its_meters(monkeypatch):
    made: list[Mock] = []
    back, leave = asyncio.Event(), asyncio.Event()

    async def connect(place: object, timeout: float) -> Mock:
        made.append(Mock(alive=bool(made), users=0))
        if len(made) > 1:
            await back.wait()
        return made[-1]

    async def use() -> None:
        async with open_bus(place, 1.0):
            await leave.wait()

    monkeypatch.setattr(bus, "_connect", connect)
    place = TcpPlace("gateway", 502, "rtu")
    async with open_bus(place, 1.0):
        users = [asyncio.create_task(use())]
        await asyncio.sleep(0)
    users.append(asyncio.create_task(use()))
    await asyncio.sleep(0)
    back.set()
    await asyncio.sleep(0)
    leave.set()
    await asyncio.gather(*users)
    assert len(made) == 2
    assert made[1].close.call_count == 1
