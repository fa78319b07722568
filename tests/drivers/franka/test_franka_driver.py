"""The driver, pylibfranka's own client within it, and the emulator."""

from __future__ import annotations

import asyncio

import numpy as np
import pytest

from cellwatt.channel import UNITS
from cellwatt.emulation import Fault
from cellwatt.errors import ConnectError, DeviceError, WrongDeviceError
from cellwatt.slots import HOST
from cellwatt_drivers.franka.fields import GROUPS
from tests.patience import PATIENCE

from ..inlet import CollectingInlet
from ..running import repeated
from .rig import ANGLES, driver, emulated, running

try:
    import pylibfranka  # noqa: F401

    LIBRARY = True
except ImportError:
    LIBRARY = False

# The rate of torque needs a unit that the daemon's own list must have.
READABLE = [g for g in GROUPS if g != "torque_rate" or "Nm/s" in UNITS]
library = pytest.mark.skipif(not LIBRARY, reason="pylibfranka is not installed")


@library
async def test_every_channel_comes_from_its_place():
    async with emulated("127.0.41.2") as emulator, running("127.0.41.2", read=READABLE) as (inlet, _):
        await inlet.until(lambda o: o.account.received > 500)
        assert emulator.counts["commanded"] == 0
    stream = inlet.readings[0].stream
    found = dict(zip(stream.names, inlet.values[-1], strict=True))
    assert [found[f"joint_{i}.position"] for i in range(1, 8)] == list(ANGLES)
    assert [found[f"joint_{i}.motor_position"] for i in range(1, 8)] == list(ANGLES)
    assert found["joint_4.velocity"] == 0.5
    assert [found[f"joint_{i}.torque"] for i in range(1, 8)] == [-3.25 * i for i in range(1, 8)]
    assert [found[f"tool.{a}"] for a in "xyz"] == [0.5, 0.0, 0.25]
    assert (found["robot.mode"], found["robot.error"], found["robot.command_success_rate"]) == (2, 0, 1)
    assert found.get("joint_4.torque_rate", 2.5) == 2.5
    assert found["tool.mass"] == pytest.approx(0.73)
    assert (np.diff(inlet.device_time) >= 1_000_000).all()
    assert inlet.resets == []


@library
async def test_what_is_lost_is_counted():
    async with emulated("127.0.41.4") as emulator, running("127.0.41.4") as (inlet, _):
        await inlet.until(lambda o: o.account.received > 100)
        for kind in ("loss", "duplicate", "reorder"):
            emulator.inject(Fault(kind, probability=0.05))
        await inlet.until(lambda o: emulator.counts["made"] > 1000)
        for kind in ("loss", "duplicate", "reorder"):
            emulator.inject(Fault(kind, probability=0))
        seen = inlet.account.received
        await inlet.until(lambda o: o.account.received > seen + 100)
        counts, account = emulator.counts, inlet.account
    # The library keeps but the newest of what has come: a busy machine loses more than the emulator did.
    assert account.missed["gap"] + account.missed[HOST] >= counts["loss"] + counts["reorder"] > 20
    assert account.missed["gap"] > counts["loss"] / 2


@library
@pytest.mark.parametrize(
    ("fault", "error"),
    [(Fault("loss"), ConnectError), (Fault("disconnect", seconds=2.0), (ConnectError, DeviceError))],
)
async def test_an_outage_is_an_error_of_the_source_and_counted_at_the_next_start(fault, error, caplog):
    address = f"127.0.41.{10 + len(fault.kind)}"
    async with emulated(address) as emulator:
        inlet = CollectingInlet()
        arm = driver(address, inlet)
        first = asyncio.create_task(arm.run())
        await inlet.until(lambda o: o.account.received > 100)
        emulator.inject(fault)
        with pytest.raises(error, match=address):
            await asyncio.wait_for(first, PATIENCE)
        emulator.inject(Fault("loss", probability=0))
        seen = inlet.account.received
        async with repeated(arm):
            await inlet.until(lambda o: o.account.received > seen)
    assert not [r for r in caplog.records if r.name == "asyncio"]  # of processes that ended in another way
    assert inlet.account.missed["outage"] > 500
    assert len(inlet.identities) == 2


@library
async def test_another_version_is_another_device():
    async with emulated("127.0.41.30", version="9"):
        with pytest.raises(WrongDeviceError, match="pylibfranka that fits"):
            await driver("127.0.41.30", CollectingInlet()).identify()
