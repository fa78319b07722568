from __future__ import annotations

import numpy as np
import pytest

from cellwatt.emulation import Fault
from cellwatt.errors import DeviceError

from ..running import Steady, strike
from .rig import ANGLES, STILL, driver, emulated, running


async def test_everything_in_two_requests():
    blocks = ["arm", "joints", "tool"]
    async with emulated() as (emulator, place), running(place, read=blocks, rate="100 Hz") as (inlet, _):
        await inlet.until(lambda o: len(o.of("motion")) > 30)
    assert set(emulator.asked) == {(0, 14), (34, 106)}
    motion = inlet.of("motion")[-1]
    found = dict(zip(motion.stream.names, motion.values[0], strict=True))
    assert [found[f"joint_{i}.position"] for i in range(1, 8)] == pytest.approx(ANGLES, abs=1e-6)
    for name in ("joint_3.velocity", "joint_7.torque", "joint_5.current", "joint_6.temperature", "tool.x", "tool.rz"):
        assert found[name] == pytest.approx(STILL[name], rel=1e-6), name
    assert inlet.of("arm")[-1].values[0].tolist() == [24, 1.25, 30, 45, 38, 7, 0, 0]
    assert motion.asked < motion.arrival
    assert set(inlet.account.missed) <= {"host stalled", "merged tick", "slow answers"}  # of a busy test machine
    assert emulator.counts["written"] == emulator.counts["refused"] == 0
    assert inlet.account.counters["motion repeats"] > 0


async def test_states_and_faults_are_reported():
    async with emulated() as (emulator, place), running(place) as (inlet, _):
        await inlet.until(lambda o: len(o.of("arm")) > 2)
        emulator.disturb({"state": 4, "fault_flags": 1 << 23})
        await inlet.until(lambda o: {"state", "fault"} <= set(o.kinds()))
    assert inlet.texts() == ["arm: ready → fault", "arm: fault flags: 0x00000000 → 0x00800000"]


@pytest.mark.parametrize("kind", ["loss", "half_frame", "delay"])
async def test_an_answer_that_does_not_come_costs_a_connection(kind):
    async with emulated() as (emulator, place), running(place, timeout="300 ms", rate="50 Hz") as (inlet, _):
        await inlet.until(lambda o: len(o.readings) > 10)
        for again in range(1, 3):
            await strike(emulator, inlet, Fault(kind, seconds=1.0))
            await inlet.until(lambda o, again=again: o.account.counters["reconnects"] == again)
    assert inlet.account.missed["timeout"] > 0
    assert inlet.account.missed["disconnected"] > 0
    values = inlet.stream("motion")
    np.testing.assert_allclose(values[:, :7], np.tile(ANGLES, (len(values), 1)), atol=1e-6)


async def test_a_joint_beyond_half_a_turn_stays_there_when_the_connection_is_lost():
    world = STILL | {"joint_1.position": 3.0}
    async with emulated(Steady(world)) as (emulator, place), running(place, timeout="300 ms") as (inlet, _):
        await inlet.until(lambda o: len(o.of("motion")) > 0)
        world["joint_1.position"] = 3.5
        await inlet.until(lambda o: o.of("motion")[-1].values[0, 0] > 3.4)
        await strike(emulator, inlet, Fault("loss"))
        await inlet.until(lambda o: o.account.counters["reconnects"] > 0)
    assert inlet.of("motion")[-1].values[0, 0] == pytest.approx(3.5, abs=1e-6)


async def test_an_arm_without_these_registers_says_so(monkeypatch):
    monkeypatch.setattr("cellwatt_drivers.kinova.emulator.ARM", (5000, 14))
    async with emulated() as (_, place):
        with pytest.raises(DeviceError, match=r"registers 0 to 13: it has no such register \(exception 2\)"):
            await driver(place).identify()
