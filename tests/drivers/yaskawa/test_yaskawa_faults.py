"""Each fault by itself: what the driver counts is what the emulator did."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager

import pytest

from cellwatt.channel import Quality
from cellwatt.emulation import Fault
from cellwatt.errors import ConnectError
from cellwatt_drivers.yaskawa import YaskawaDriver, wire
from cellwatt_drivers.yaskawa.emulator import YaskawaEmulator
from tests.patience import PATIENCE, eventually

from ..running import once, strike
from .rig import Inlet, emulated, running, settings


@asynccontextmanager
async def struck(fault: Fault, *, times: int, **changes: object) -> AsyncIterator[tuple[YaskawaEmulator, Inlet]]:
    """A driver and an emulator after a fault has struck ``times`` times and calm has returned."""
    changes = {"timeout": "200 ms", "read": ["position", "torque"], "rate": "100 Hz"} | changes
    async with emulated() as (emulator, port), running(settings(port, **changes)) as (_, inlet, _):
        await eventually(lambda: len(inlet.of("torque")) > 5)
        await strike(emulator, inlet, fault, times)
        yield emulator, inlet


def counters(inlet: Inlet) -> dict[str, int]:
    return {k: n for k, n in inlet.account.counters.items() if k not in {"retries", "merged ticks"}}


async def test_loss_costs_the_slots_that_the_wait_took():
    async with struck(Fault("loss", probability=0.2), times=10) as (emulator, inlet):
        lost = emulator.counts["loss"]
        assert counters(inlet) == {"timeouts": lost}
        assert inlet.account.missed["timeout"] == lost
        assert inlet.account.missed["slow answers"] + inlet.account.missed["host stalled"] > 0  # a busy test machine's
        assert inlet.account.counters["retries"] == 0


@pytest.mark.parametrize(("kind", "counted"), [("half_frame", ["timeouts", "malformed"]), ("garbage", ["malformed"])])
async def test_half_frames_cost_their_slot_and_garbage_nothing(kind, counted):
    async with struck(Fault(kind, probability=0.2), times=15) as (emulator, inlet):
        assert counters(inlet) == dict.fromkeys(counted, emulator.counts[kind])
        assert inlet.account.missed["timeout"] == inlet.account.counters["timeouts"]


async def test_duplicates_are_discarded():
    async with struck(Fault("duplicate", probability=0.3), times=20) as (emulator, inlet):
        assert counters(inlet) == {"duplicates": emulator.counts["duplicate"]}
        asked = sum(n for r, n in emulator.asked.items() if r.command in {wire.POSITION, wire.TORQUE})
        greeting, under_way = 2, {0, 1}
        assert asked - greeting - len(inlet.readings) in under_way


def late(inlet: Inlet) -> int:
    """Late samples that were given; each was missed at first, and answers to a request from before it came."""
    given = [r for r in inlet.readings if r.quality is not None and (r.quality == Quality.LATE).all()]
    assert all(r.asked is not None and r.arrival - r.asked > 200e6 for r in given)
    assert inlet.account.counters["late"] == len(given)
    return len(given)


def assert_in_order(inlet: Inlet) -> None:
    for stream in ("position", "torque"):
        middles = [r.asked + r.arrival for r in inlet.of(stream) if r.asked is not None]
        assert middles == sorted(middles)


async def test_late_answers_are_given_where_nothing_newer_was():
    async with struck(Fault("delay", probability=0.1, seconds=0.3), times=10) as (emulator, inlet):
        came = emulator.counts["delay"]
        await eventually(lambda: inlet.account.counters["late answers"] == came)
        assert inlet.account.counters["timeouts"] == came
        assert inlet.account.missed["timeout"] == came - late(inlet)
        assert_in_order(inlet)


async def test_silence_ends_the_connection_and_the_next_one_counts_the_gap():
    changes = {"timeout": "30 ms", "silence": "200 ms", "read": ["position"], "rate": "100 Hz"}
    async with emulated() as (emulator, port):
        inlet = Inlet()
        driver = YaskawaDriver("arm", settings(port, **changes), inlet)
        first = asyncio.create_task(driver.run())
        await eventually(lambda: len(inlet.readings) > 5)
        emulator.inject(Fault("loss"))
        with pytest.raises(ConnectError, match=r"no good answer from 127.0.0.1:\d+ for 0.\d s; the last: no answer"):
            await asyncio.wait_for(first, PATIENCE)
        before = inlet.account.expected
        emulator.inject(Fault("loss", probability=0))
        await asyncio.sleep(0.1)
        seen = len(inlet.readings)
        async with once(driver):
            await eventually(lambda: len(inlet.readings) > seen + 5)
    assert inlet.account.missed["disconnected"] >= 10
    assert inlet.account.expected - before >= 15
    assert len(inlet.identities) == 2


async def test_a_busy_controller_is_asked_again():
    changes = {"read": ["position"], "rate": "20 Hz", "timeout": "100 ms"}
    async with emulated(busy="0.3") as (emulator, port), running(settings(port, **changes)) as (_, inlet, _):
        await eventually(lambda: len(inlet.readings) > 30)
        account, busy = inlet.account, emulator.counts["busy"]
        assert busy > 5
        under_way = {0, 1}
        assert busy - account.counters["busy answers"] in under_way
        assert account.counters["busy answers"] - account.counters["retries"] - account.missed["busy"] in under_way
        assert account.counters["retries"] > 0
