"""A meter of another make than the map is refused, and the message says which it probably is."""

from __future__ import annotations

import math
from types import SimpleNamespace

import pytest
from pymodbus.simulator import DataType, SimData

from cellwatt.errors import ConnectError, ProtocolError, WrongDeviceError
from cellwatt_drivers.modbus_meter import ModbusMeterDriver, likeness
from cellwatt_drivers.modbus_meter.likeness import contradiction, doubt
from cellwatt_drivers.modbus_meter.meter_map import METERS, packaged_map
from cellwatt_drivers.shared.modbus import RefusedError

from ..inlet import CollectingInlet
from .rig import answering, emulated, settings

ALIKE = {"schneider_iem3000", "schneider_pm5000"}
"""Their voltages and frequency stand in the same registers."""


async def identify(place: str, **changes: object):
    return await ModbusMeterDriver("m", settings(place, **changes), CollectingInlet()).identify()


@pytest.mark.parametrize("real", METERS)
async def test_no_map_takes_another_meter_for_its_own(real):
    async with emulated(meter=real) as (_, place):
        for wanted in METERS:
            if wanted == real or {wanted, real} == ALIKE:
                assert (await identify(place, meter=wanted)).model == packaged_map(wanted).model
                continue
            with pytest.raises(WrongDeviceError, match=rf"is not a .*; it answers like .*\(meter: {real}\)"):
                await identify(place, meter=wanted)


def em24(cosine: float, kilowatts: float) -> list[int]:
    """Registers of a Carlo Gavazzi EM24 on RS-485: where an EM340 has the frequency, it has phase 2's power factor."""
    words = [0] * 100

    def write(address: int, number: float) -> None:
        words[address : address + 2] = [round(number) & 0xFFFF, round(number) >> 16]

    power = 1000 * kilowatts / 3
    for phase in range(3):
        write(0x00 + 2 * phase, 2300)
        write(0x0C + 2 * phase, 1000 * power / cosine / 230)
        write(0x12 + 2 * phase, 10 * power)
    write(0x28, 10 * 3 * power)
    write(0x2E, 10 * 3 * power)  # demand of the last minutes: W, then VA
    write(0x30, 10 * 3 * power / cosine)
    words[0x32:0x36] = [round(1000 * cosine)] * 4
    words[0x37] = 500
    return words


@pytest.mark.parametrize(("cosine", "kilowatts"), [(0.41, 0.03), (0.69, 12.0)])
async def test_an_em24_whose_power_factor_looks_like_a_frequency_is_no_em340(cosine, kilowatts):
    async with answering(SimData(0, values=em24(cosine, kilowatts), datatype=DataType.REGISTERS)) as place:
        for read in (None, ["supply.power"]):
            with pytest.raises(WrongDeviceError, match=r"is not a EM340: phase_\d\.power_factor reads"):
                await identify(place, meter="gavazzi_em340", read=read)


def phase(voltage: float, current: float, power: float, factor: float) -> dict[str, float]:
    """As it stands in the registers of an EM340."""
    return {
        "phase_1.voltage": 10 * voltage,
        "phase_1.current": 1000 * current,
        "phase_1.power": 10 * power,
        "phase_1.power_factor": 1000 * factor,
    }


@pytest.mark.parametrize(
    ("values", "fits"),
    [
        (phase(230, 2, 460, 1.0), True),
        (phase(230, 2, -230, -0.5), True),
        (phase(230, 2, 230, -0.5), True),  # the sign may say that the current leads
        (phase(230, 2, 276, 0.99), True),  # a rectifier's current: 0.6 by its harmonics, its cosine is 0.99
        (phase(230, 0.01, 2.3, 0.0), True),  # next to nothing
        (phase(230, 2, 460, math.nan), True),
        (phase(230, 2, 230, 0.0), False),
        (phase(230, 2, -460, 0.5), False),
    ],
)
def test_power_factor_and_power_are_judged_together(values, fits):
    assert bool(contradiction(packaged_map("gavazzi_em340"), values)) != fits


async def test_mains_that_may_be_off():
    async with answering(SimData(0, values=[0] * 4000, datatype=DataType.REGISTERS)) as place:
        with pytest.raises(WrongDeviceError, match=r"check meter, map \(addresses count from 0\), unit"):
            await identify(place)
        assert (await identify(place, mains_may_be_off=True)).model == "SDM630"


async def test_how_a_silent_meter_is_delivered():
    async with emulated(meter="siemens_pac2200", unit="126") as (_, place):
        with pytest.raises(ConnectError, match="PAC2200 is delivered with unit 126, 19200 baud, no parity"):
            await identify(place, meter="siemens_pac2200", timeout="50 ms", retries=0)
        assert (await identify(place, meter="siemens_pac2200", unit=126)).model == "PAC2200"


@pytest.mark.parametrize(
    ("found", "why"),
    [
        ({"phase_1.voltage": 230.0, "phase_2.voltage": 0.0, "supply.frequency": 50.0}, ""),
        ({"phase_1.voltage": math.nan, "phase_2.voltage": 0.0, "supply.frequency": 50.0}, "no phase has a voltage"),
        ({"phase_1.voltage": 230.0, "supply.frequency": 0.0}, "no frequency"),
        ({"phase_1.voltage": 230.0, "supply.frequency": math.nan}, "no frequency"),
        ({"phase_1.voltage": 230.0, "supply.frequency": 500.0}, "expected 40 to 70"),
        ({"phase_1.voltage": math.inf}, "reads inf V"),
        ({"phase_1.voltage": -230.0, "phase_2.voltage": 230.0}, "reads -230 V"),
        ({"supply.power": -9e7}, ""),
        ({}, ""),
    ],
)
def test_voltage_and_frequency_are_judged_together(found, why):
    said = doubt(packaged_map("eastron_sdm630"), found, may_be_off=False)
    assert why in said
    assert bool(why) == bool(said)


@pytest.mark.parametrize("error", [RefusedError("it is busy", 6), ProtocolError("cut"), ConnectError("gone")])
async def test_a_look_at_what_it_is_hides_not_what_it_is_not(monkeypatch, error):
    async def refuse(*_):
        raise error

    monkeypatch.setattr(likeness, "_numbers", refuse)
    said = await likeness.wrong(SimpleNamespace(place="here"), 1, packaged_map("eastron_sdm630"), "no voltage")
    assert "unit 1 at here is not a SDM630: no voltage" in str(said)
