from __future__ import annotations

import asyncio
from collections.abc import Mapping

import numpy as np
import pytest
from pymodbus.simulator import DataType, SimData

from cellwatt.channel import Quality
from cellwatt.driver import Identity
from cellwatt.emulation import Fault
from cellwatt.errors import ConnectError, WrongDeviceError
from cellwatt_drivers.modbus_meter import ModbusMeterDriver
from cellwatt_drivers.modbus_meter.meter_map import METERS
from tests.patience import PATIENCE

from ..inlet import CollectingInlet
from .rig import answering, emulated, running, settings

TRUTH = {
    "phase_1.voltage": 230.0,
    "phase_1.current": 1.25,
    "phase_3.power": 100.0,
    "supply.power": 500.0,
    "supply.frequency": 50.0,
    "supply.apparent_power": 575.0,
    "supply.power_factor": 500 / 575,
}


def row(run) -> dict[str, float]:
    return dict(zip(run.driver.streams[0].names, run.inlet.readings[-1].values[0], strict=True))


@pytest.mark.parametrize(("meter", "address"), [*((name, "127.0.0.1:0") for name in METERS), (METERS[0], "pty")])
async def test_every_meter_in_si_units(meter, address):
    async with emulated(address, meter=meter) as (_, place), running(settings(place, meter=meter)) as run:
        await run.inlet.until(lambda o: len(o.readings) >= 2)
    found = row(run)
    for name, value in TRUTH.items():
        if name in found:
            assert found[name] == pytest.approx(value, abs=max(1e-3 * value, 1e-3)), name
    assert not run.failures
    assert all(r.quality.tolist() == [Quality.GOOD] for r in run.inlet.readings)


async def test_against_a_server_that_we_did_not_write():
    """pymodbus's own server with plain data of an iEM3150."""
    holding = [
        SimData(0x0BF3, values=[2.5], datatype=DataType.FLOAT32),
        SimData(0x0C83, values=[123_456_789], datatype=DataType.INT64),
    ]
    async with answering(*holding) as place:
        wanted = settings(place, meter="schneider_iem3000", read=["supply.energy_imported", "supply.power"], unit=7)
        async with running(wanted) as run:
            await run.inlet.until(lambda o: len(o.readings) >= 2)
    assert run.inlet.values[0] == pytest.approx([123_456_789 * 3600.0, 2500.0])


async def test_blocks_that_are_refused_are_read_apart():
    async with emulated(strict="yes") as (emulator, place), running(settings(place)) as run:
        await run.inlet.until(lambda o: len(o.readings) >= 3)
        refused = emulator.counts["refused"]
        seen = len(run.inlet.readings)
        await run.inlet.until(lambda o: len(o.readings) >= seen + 3)
        assert emulator.counts["refused"] == refused, "asked once, then known"
    assert refused == run.inlet.account.counters["refused reads"] >= 1
    assert row(run)["supply.power"] == pytest.approx(500.0)
    assert not np.isnan(run.inlet.values).any()


async def test_a_value_that_the_meter_lacks_is_told_once_and_stays_nan():
    async with answering(SimData(0x34, values=[500.0], datatype=DataType.FLOAT32)) as place:
        async with running(settings(place, read=["supply.power", "supply.phase"])) as run:
            await run.inlet.until(lambda o: len(o.readings) >= 3)
        [told] = run.inlet.texts("value_refused")
        assert told.startswith("meter: supply.phase is left out")
        assert all(np.isnan(run.inlet.values[:, 1]))
        assert run.inlet.values[:, 0] == pytest.approx([500.0] * len(run.inlet.readings))
        other = ModbusMeterDriver("m", settings(place, read=["phase_1.voltage"]), CollectingInlet())
        with pytest.raises(WrongDeviceError, match="not a SDM630: it has none of its registers"):
            await other.run()


async def test_meters_on_one_serial_line_take_turns():
    async with emulated("pty", unit="1,2,3") as (emulator, line):
        inlets = [CollectingInlet() for _ in range(3)]
        drivers = [
            ModbusMeterDriver(f"m{u}", settings(line, unit=u, rate="10 Hz"), o) for u, o in enumerate(inlets, start=1)
        ]
        for number, meter in emulator.meters.items():
            meter.energy = number * 3.6e6
        tasks = [asyncio.create_task(d.run()) for d in drivers]
        for inlet in inlets:
            await inlet.until(lambda o: len(o.readings) >= 3)
        tasks[0].cancel()  # one leaves, the line stays open for the others
        seen = len(inlets[2].readings)
        await inlets[2].until(lambda o: len(o.readings) >= seen + 3)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
    column = drivers[0].streams[0].names.index("supply.energy_imported")
    for number, inlet in enumerate(inlets, start=1):
        assert inlet.values[0, column] == pytest.approx(number * 3.6e6, rel=1e-3)


async def test_each_meter_on_a_line_has_its_own_timeout():
    async with emulated(unit="1,2") as (emulator, place):
        emulator.inject(Fault("delay", seconds=0.2))
        waits = [settings(place, unit=1, timeout="50 ms"), settings(place, unit=2, timeout=f"{PATIENCE} s")]
        fast, slow = (ModbusMeterDriver("m", wanted, CollectingInlet()).identify() for wanted in waits)
        too_late, meter = await asyncio.gather(fast, slow, return_exceptions=True)
    assert isinstance(too_late, ConnectError) and isinstance(meter, Identity), (too_late, meter)


async def test_counters_that_wrap_are_reset_and_misread(tmp_path):
    file = tmp_path / "wrapping.yaml"
    file.write_text(
        "maker: Acme\nmodel: A1\nfunction: input\ntype: uint16\nvalues:\n"
        "  supply.energy_imported: {address: 0, unit: Wh, wraps_at: 10000}\n"
    )
    zero = [9975, 9980, 0, 9985]
    wrap = [9990, 9995, 0, 5, 10, 15, 20]
    high_then_reset = [700, 25, 30, 3, 4, 5, 6, 7]
    true = [9980, 9980, 9985, 9990, 9995, *[9995] * 3, 10015, 10020, 10020, 10025, 10030, *[10030] * 3, 10033, 10034]
    held = [0, 1, 0, 0, 0, *[1] * 3, 0, 0, 1, 0, 0, *[1] * 3, 0, 0]
    readings = iter(zero + wrap + high_then_reset)
    async with emulated(map=str(file)) as (emulator, place):
        emulator.meters[1]._measured = lambda t: {"supply.energy_imported": 3600.0 * next(readings, 7)}
        async with running(settings(place, map=str(file))) as run:
            await run.inlet.until(lambda o: len(o.readings) >= len(true))
    assert run.inlet.values[: len(true), 0] / 3600.0 == pytest.approx(true)
    quality = np.concatenate([r.quality for r in run.inlet.readings])
    assert quality[: len(true)].tolist() == held
    kinds = run.inlet.kinds()
    assert [kinds.count(f"counter_{what}") for what in ("misread", "wrapped", "reset")] == [2, 1, 1]
    assert run.inlet.account.counters["counter misread"] == 2


async def mapped(file, kind: str, values: Mapping[str, str], words: list[int]) -> CollectingInlet:
    """A driver with its own map, after three samples of these registers."""
    listed = "".join(f"  {name}: {{{value}}}\n" for name, value in values.items())
    file.write_text(f"maker: Acme\nmodel: A1\nfunction: holding\n{kind}\nvalues:\n{listed}")
    registers = SimData(0, values=words, datatype=DataType.REGISTERS)
    async with answering(registers) as place, running(settings(place, map=str(file))) as run:
        await run.inlet.until(lambda o: len(o.readings) >= 3)
    return run.inlet


async def test_overload_and_no_value(tmp_path):
    values = {
        "phase_1.voltage": "address: 0, unit: V, scale: 0.1, largest: 0x7FFEFFFF",
        "phase_1.current": "address: 2, unit: A, missing: [-2147483648]",
        "phase_2.current": "address: 4, unit: A, scale: 0.1, type: uint16",
        "phase_1.power": "address: 5, unit: W",
    }
    words = [0x0000, 0x7FFF, 0x0000, 0x8000, 0xFFFF, 0x0000, 0x8000]
    inlet = await mapped(tmp_path / "limits.yaml", "type: int32\nword_order: little", values, words)
    assert np.isnan(inlet.values).all()
    assert inlet.readings[0].quality.tolist() == [Quality.CLIPPED]
    assert inlet.account.counters["overloads"] == len(inlet.readings)
    assert inlet.kinds().count("overload") == 1


async def test_powers_of_ten_that_the_meter_sets_itself(tmp_path):
    """As SunSpec's meters: one register scales several values; -32768 is none."""
    values = {
        "phase_1.power": "address: 0, unit: W, scale_register: 2",
        "supply.power": "address: 1, unit: W, scale_register: 2",
        "supply.frequency": "address: 3, unit: Hz, scale_register: 4, between: [10, 500]",
        "phase_1.current": "address: 5, unit: A, scale_register: 6",
        "phase_1.voltage": "address: 7, unit: V, scale: 0.1",
    }
    words = [0x8000, 0xFF38, 1, 5002, 0xFFFE, 77, 0x8000, 2301]
    inlet = await mapped(tmp_path / "sunspec.yaml", "type: int16", values, words)
    assert inlet.values[0] == pytest.approx([np.nan, -2000.0, 50.02, np.nan, 230.1], nan_ok=True)


async def test_a_line_that_is_not_there_is_said():
    driver = ModbusMeterDriver("m", settings("/dev/nonexistent"), CollectingInlet())
    with pytest.raises(ConnectError, match=r"^/dev/nonexistent: no such port"):
        await driver.run()
