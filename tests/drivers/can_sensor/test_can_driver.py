from __future__ import annotations

import asyncio
import os
import select
import time
from pathlib import Path

import can
import numpy as np
import pytest

from cellwatt.channel import Quality
from cellwatt.clock import ClockModel
from cellwatt.emulation import Fault
from cellwatt.errors import ConnectError, WrongDeviceError
from cellwatt_drivers.can_sensor import CanSensorDriver, listening
from tests.patience import PATIENCE, eventually

from ..inlet import CollectingInlet
from ..running import repeated, strike
from .rig import KERNEL, emulated, running, settings


async def test_samples_in_si_units_on_the_bus_time():
    async with emulated() as (_, place), running(settings(place)) as run:
        await run.inlet.until(lambda o: o.account.received >= 30)
    assert run.inlet.stream("current")[:, 0] == pytest.approx(-2.5)
    assert run.inlet.stream("voltage_1")[:, 0] == pytest.approx(48.0)
    assert all(r.device_time[-1] <= r.arrival <= r.device_time[-1] + PATIENCE * 1e9 for r in run.inlet.readings)
    assert len(run.inlet.brackets) >= 2
    assert run.inlet.account.missed == {}
    assert run.inlet.identities[0].model == "IVT-S"
    assert not run.failures


async def test_the_clock_is_known_from_the_first_second_on():
    async with emulated() as (_, place), running(settings(place)) as run:
        await run.inlet.until(lambda o: o.account.received >= 100)
    model = ClockModel(CanSensorDriver.least_delay)
    device_time, not_before = run.inlet.brackets[0]
    model.bracket(device_time, not_before)
    found = [model.stamp(r.device_time, r.arrival) for r in run.inlet.readings if r.stream.name == "current"]
    assert model.resets == 0
    times, bounds = (np.concatenate(x) for x in zip(*found, strict=True))
    truth = np.concatenate([r.device_time for r in run.inlet.readings if r.stream.name == "current"])
    # This PC's clock stamps the frames, so the truth is known.
    assert np.all(np.abs(times - truth) <= bounds)
    assert bounds[-1] < 100_000_000


async def test_lost_frames_are_counted_to_the_last():
    async with emulated() as (emulator, place), running(settings(place)) as run:
        await run.inlet.until(lambda o: o.account.received >= 10)
        await strike(emulator, run.inlet, Fault("loss", probability=0.3), 20)
    assert run.inlet.account.missed == {"gap": emulator.counts["loss"]}


async def test_duplicates_cut_and_foreign_frames():
    async with emulated() as (emulator, place), running(settings(place)) as run:
        await run.inlet.until(lambda o: o.account.received >= 10)
        emulator.inject(Fault("duplicate", probability=0.3))
        emulator.inject(Fault("half_frame", probability=0.2))
        await run.inlet.until(lambda o: o.account.counters["malformed"] >= 5 and o.account.counters["duplicates"] >= 5)
        for kind in ("duplicate", "half_frame"):
            emulator.inject(Fault(kind, probability=0.0))
        emulator.write(b"t7FF0\rT000005210\r")
        seen = run.inlet.account.received
        await run.inlet.until(lambda o: o.account.received >= seen + 10)
    account = run.inlet.account
    assert account.missed["gap"] == emulator.counts["half_frame"] == account.counters["malformed"]
    assert account.counters["duplicates"] == emulator.counts["duplicate"]
    assert account.counters["other frames"] == 2
    assert run.inlet.kinds().count("malformed_frame") == 1


class Pausing(CollectingInlet):
    """The process pauses at each look at the clock until a reading is handed over."""

    def now(self):
        end = time.monotonic() + (0.0 if self.readings else 0.03)
        while time.monotonic() < end:
            pass
        return super().now()


async def test_a_pause_of_the_process_sets_no_arrival_back(bus, monkeypatch):
    monkeypatch.setattr(listening, "_MOST_AT_ONCE", 1)
    bus.put(*(can.Message(arbitration_id=0x521, is_extended_id=False, data=bytes([0, n, 0, 0, 0, 1])) for n in (1, 2)))
    async with repeated(CanSensorDriver("battery", settings(KERNEL), Pausing())) as run:
        await run.inlet.until(lambda o: o.account.received >= 2)
    assert len(run.inlet.readings) == 2


async def test_error_frames_and_bus_off_are_told(bus):
    async with running(settings(KERNEL, silence="10 s")) as run:
        for error in (0x88, 0x40, 0x100):
            bus.put(can.Message(arbitration_id=error, is_error_frame=True, data=bytes(8)))
        await run.inlet.until(lambda o: "bus_active" in o.kinds())
    assert run.inlet.account.counters["error frames"] == 3
    assert run.inlet.account.counters["error frames: bus off"] == 1
    assert [k for k in run.inlet.kinds() if k.startswith("bus_")] == ["bus_off", "bus_active"]
    assert not run.failures


async def test_a_bus_that_was_restarted_while_it_was_closed_is_no_longer_off(bus):
    async with running(settings(KERNEL, silence="200 ms")) as run:
        bus.put(can.Message(arbitration_id=0x40, is_error_frame=True, data=bytes(8)))
        await run.inlet.until(lambda _: run.failures)
        bus.put(can.Message(arbitration_id=0x123, is_extended_id=False))
        await run.inlet.until(lambda _: "only frames" in str(run.failures[-1]))
    assert "the controller is bus-off" in str(run.failures[0])
    assert [k for k in run.inlet.kinds() if k.startswith("bus_")] == ["bus_off", "bus_active"]


async def test_an_adapter_that_is_unplugged_is_let_go():
    """Else it comes back under another name, as the system keeps the old one for who has it open."""
    near, far = os.openpty()
    name = os.ttyname(far)
    run = asyncio.create_task(CanSensorDriver("battery", settings(name), CollectingInlet()).run())
    await eventually(lambda: select.select([near], [], [], 0)[0], "its first command")
    os.close(far)
    assert holds(name)
    os.close(near)
    with pytest.raises(ConnectError, match="slcan"):
        await run
    assert not holds(name)


def holds(terminal: str) -> bool:
    """True if this process has the terminal open, whose name ends in a remark once its other side is gone."""
    links = [link for link in Path("/proc/self/fd").iterdir() if link.is_symlink()]
    return any(str(link.readlink()).split(" ")[0] == terminal for link in links)


async def test_a_silent_sensor_is_given_up_and_what_was_lost_is_counted():
    # The numbers of messages repeat after 16: slow ones, so that the time of a busy PC tells how often they did.
    slow = {"rates": {"current": "25 Hz", "voltage_1": "20 Hz"}, "silence": "300 ms"}
    async with (
        emulated(cycles="current=40,voltage_1=50") as (emulator, place),
        running(settings(place, **slow)) as run,
    ):
        await run.inlet.until(lambda o: o.account.received >= 10)
        emulator.inject(Fault("disconnect", seconds=0.8))
        await run.inlet.until(lambda o: len(o.identities) == 2)
        seen = run.inlet.account.received
        await run.inlet.until(lambda o: o.account.received >= seen + 10)
    assert "not one frame" in str(run.failures[0])
    missed, counts = run.inlet.account.missed, emulator.counts
    unheard = counts["unheard"] + counts["sent"] - run.inlet.account.received
    # What was sent while the driver opened the bus anew is lost, too.
    assert 0 <= missed.total() - emulator.counts["disconnected"] <= unheard
    assert missed["disconnected"] > 0


async def test_flags_of_the_sensor():
    async with emulated() as (emulator, place), running(settings(place)) as run:
        await run.inlet.until(lambda o: o.account.received >= 6)
        emulator.status = 0x1
        await run.inlet.until(lambda o: o.account.counters["flag I_Overcurrent"] >= 3)
        clipped = run.inlet.readings[-1]
        emulator.status = 0x2
        await run.inlet.until(lambda o: o.account.counters["flag I_Channel_Error"] >= 3)
        missing = run.inlet.readings[-1]
        emulator.status = 0x0
        await run.inlet.until(lambda o: sum("raises no flags" in text for text in o.texts()) == 2)
    assert clipped.quality[-1] == Quality.CLIPPED
    assert np.isfinite(clipped.values[-1]).all()
    assert missing.quality[-1] == Quality.MISSING
    assert np.isnan(missing.values[-1]).all()
    assert run.inlet.texts("sensor_flags").count("battery: current raises I_Overcurrent") == 1


@pytest.mark.parametrize(
    ("frame", "error", "match"),
    [
        (None, ConnectError, "not one frame: is the sensor on"),
        (
            can.Message(arbitration_id=0x123, is_extended_id=False),
            WrongDeviceError,
            r"only frames 0x123, none of the IVT-S's \(0x521, 0x522\)",
        ),
        (
            can.Message(arbitration_id=0x88, is_error_frame=True, data=bytes(8)),
            ConnectError,
            r"only \d+ error frames: wrong bit rate",
        ),
    ],
)
async def test_nobody_other_nodes_and_only_errors_are_told_apart(frame, error, match, bus):
    bus.put(*([frame] if frame else []))
    with pytest.raises(error, match=match):
        await CanSensorDriver("battery", settings(KERNEL, silence="100 ms"), CollectingInlet()).run()


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"interface": "slcan", "channel": "/dev/nonexistent"}, "slcan /dev/nonexistent cannot be opened"),
        ({"interface": "socketcan", "channel": "can_none"}, "socketcan can_none cannot be opened.*ip link set"),
    ],
)
async def test_a_bus_that_is_not_there(changes, why):
    driver = CanSensorDriver("battery", settings(KERNEL, **changes), CollectingInlet())
    with pytest.raises(ConnectError, match=why):
        await driver.identify()
