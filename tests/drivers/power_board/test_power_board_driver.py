"""The driver against the emulator over a real pty: every fault, with counts that agree."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt import Quality
from cellwatt.emulation import Fault
from tests.drivers.power_board.rig import cell, settled
from tests.patience import eventually

FAST = {"rate": "500"}


@pytest.mark.parametrize(("mode", "batch"), [("api", "1"), ("api_escaped", "2"), ("transparent", "1")])
async def test_all_samples_come_in_every_mode(mode: str, batch: str) -> None:
    async with cell(mode=mode, batch=batch, rate="400") as (emulator, run):
        counts = await settled(emulator, run.inlet, 200)
        account = run.inlet.account
        assert account.received == counts["made"] == counts["sent"]
        assert not account.missed
        assert run.failures == []
        assert counts["heard"] == 0, "the driver wrote to the port"
        step = np.diff(run.inlet.device_time)
        assert np.all(np.abs(step - 2_500_000) <= 1000)


async def test_values_are_those_of_the_moment_they_were_sampled() -> None:
    async with cell(phases="3", **FAST) as (emulator, run):
        await settled(emulator, run.inlet, 250)
        inlet = run.inlet
        power, seconds = inlet.channel("supply.power"), inlet.device_time / 1e9
        # the slope of Slope, 10 W/s, and no more than three phases rounded to 10 mW beside it
        assert np.ptp(power - 10.0 * seconds) <= 0.03
        assert np.all(inlet.channel("supply.voltage") == 230.0)
        assert np.allclose(inlet.channel("supply.current"), power / 230.0, atol=0.003)
        assert np.allclose(inlet.channel("phase_2.power"), power / 3, atol=0.02)
        assert all(r.quality is not None and (r.quality == Quality.GOOD).all() for r in inlet.readings)


async def test_single_phase_and_explicit_frames() -> None:
    async with cell(phases="1", explicit="yes", mode="api_escaped", **FAST) as (emulator, run):
        await settled(emulator, run.inlet, 50)
        inlet = run.inlet
        assert np.all(inlet.channel("supply.power") == inlet.channel("phase_1.power"))
        assert np.all(inlet.channel("supply.current") == inlet.channel("phase_1.current"))
        assert inlet.identities[0].model == "power board 7"
        assert inlet.account.counters["frames: modem status"] == 1


@pytest.mark.parametrize(
    ("kind", "mode", "batch"),
    [
        ("loss", "api_escaped", 2),
        ("half_frame", "transparent", 1),
        ("duplicate", "api", 1),
        ("reorder", "api_escaped", 2),
        ("garbage", "transparent", 1),
    ],
)
async def test_fault_is_counted_as_injected(kind: str, mode: str, batch: int) -> None:
    async with cell(mode=mode, batch=str(batch), **FAST) as (emulator, run):
        inlet = run.inlet
        await settled(emulator, inlet, 20)
        emulator.inject(Fault(kind, probability=0.3, seconds=0.02))
        await eventually(lambda: emulator.counts.get(kind, 0) >= 15)
        emulator.inject(Fault(kind, probability=0.0))
        counts = await settled(emulator, inlet, emulator.counts["made"] + 10 * batch)
        account = inlet.account
        lost = batch * counts[kind] if kind in {"loss", "half_frame"} else 0
        assert account.missed.total() == account.missed["gap"] == lost
        assert account.received == counts["made"] - lost == counts["sent"]
        assert account.counters["duplicates"] == (counts[kind] if kind == "duplicate" else 0)
        assert account.counters["reordered"] == (counts[kind] if kind == "reorder" else 0)
        assert account.counters["late"] == 0
        assert (account.counters["garbage bytes"] > 0) == (kind in {"garbage", "half_frame"})
        assert run.failures == []
        assert inlet.resets == []
        assert np.ptp(inlet.channel("supply.power") - 10.0 * inlet.device_time / 1e9) <= 0.03


async def test_port_vanishes_and_comes_back(tmp_path) -> None:
    async with cell(link=str(tmp_path / "board"), **FAST) as (emulator, run):
        inlet = run.inlet
        await settled(emulator, inlet, 50)
        for n in (1, 2):
            emulator.inject(Fault("disconnect", seconds=0.3))
            await eventually(lambda n=n: len(inlet.identities) == n + 1)
        counts = await settled(emulator, inlet, emulator.counts["made"] + 20)
        assert counts["disconnect"] == 2
        assert counts["unheard"] > 100
        assert inlet.account.missed == {"gap": counts["unheard"]}
        assert inlet.account.received == counts["made"] - counts["unheard"] == counts["sent"]
        assert inlet.resets == [], "the board's clock went on: its numbering tells what was lost"
        assert any("the port is gone" in str(e) for e in run.failures)
        assert all("the port is gone" in str(e) or "no such port" in str(e) for e in run.failures)
