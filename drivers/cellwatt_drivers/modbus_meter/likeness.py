"""Tells a meter from another make's by what several of its registers say together."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping, Sequence
from functools import cache

from cellwatt.errors import ConnectError, DeviceError, ProtocolError, WrongDeviceError
from cellwatt_drivers.modbus_meter.bus import Bus
from cellwatt_drivers.modbus_meter.meter_map import METERS, MeterMap, MeterName, packaged_map
from cellwatt_drivers.modbus_meter.reader import Reader
from cellwatt_drivers.shared.modbus import ILLEGAL_FUNCTION, RefusedError

_LOOKS = 3
"""Readings in a row that must contradict themselves."""
_LOADED = 10.0
"""VA of a phase, from which its power factor means anything."""
_BELOW = 0.2
"""By how much a power factor may be below power over voltage times current."""


def doubt(meter: MeterMap, found: Mapping[str, float], may_be_off: bool) -> str:
    """Return why these first values, as they stand in the registers, are not this meter's; empty if they may be.

    A mains meter has a frequency, and a voltage on at least one phase: 0 and NaN there are another meter's, unless
    the mains ``may_be_off``. What the map gives no range for is not looked at.
    """
    values = {n: number * meter.values[n].scale for n, number in found.items() if meter.values[n].between}
    silent = [n for n, value in values.items() if value == 0 or math.isnan(value)]
    for name, value in values.items():
        low, high = meter.values[name].between or (-math.inf, math.inf)
        if name not in silent and not low <= value <= high:
            return f"{name} reads {value:.4g} {meter.values[name].unit}, expected {low:g} to {high:g}"
    if may_be_off:
        return ""
    for quantity, what in (("V", "no phase has a voltage"), ("Hz", "the mains has no frequency")):
        due = [n for n in values if _quantity(meter, n) == quantity]
        if due and all(n in silent for n in due):
            told = ", ".join(f"{n} reads {values[n]:g}" for n in due)
            return f"{what}: {told}"
    return ""


def contradiction(meter: MeterMap, found: Mapping[str, float]) -> str:
    """Return which of these values, as they stand in the registers, contradict each other; empty if none do.

    A phase's power factor is its power over voltage times current, or the cosine of its angle, which is above that
    where the current has harmonics: one that is clearly below is another meter's register.
    """
    values = {n: number * meter.values[n].factor for n, number in found.items()}
    for name in meter.factors:
        phase = name.removesuffix(".power_factor")
        voltage, current, power = (values.get(f"{phase}.{q}", math.nan) for q in ("voltage", "current", "power"))
        apparent = abs(voltage * current)
        if apparent >= _LOADED and abs(values.get(name, math.nan)) < abs(power) / apparent - _BELOW:
            share = f"{abs(power) / apparent:.2g} of voltage times current"
            return f"{name} reads {values[name]:.3g}, but {phase}.power is {share}"
    return ""


async def examine(bus: Bus, unit: int, meter: MeterMap, found: Mapping[str, float], may_be_off: bool) -> None:
    """Raise ``WrongDeviceError`` where the meter is another one than the map is for, and say which, if that shows.

    ``found`` are values that were read already; where there is no voltage or no frequency among them, it is read here.
    """
    known = {_quantity(meter, name) for name in found}
    left = [name for name in meter.checked if _quantity(meter, name) not in known]
    found = {**found, **await _numbers(bus, unit, meter, left)}
    if reason := doubt(meter, found, may_be_off):
        raise await wrong(bus, unit, meter, reason)
    for _ in range(_LOOKS):  # a load may change from one register to the next
        found = await _numbers(bus, unit, meter, meter.related)
        reason = contradiction(meter, found)
        if not reason:
            return
    raise await wrong(bus, unit, meter, reason)


def _quantity(meter: MeterMap, name: str) -> str:
    return meter.values[name].unit.removeprefix("k")


async def wrong(bus: Bus, unit: int, meter: MeterMap, reason: str) -> WrongDeviceError:
    """Return the error that says what was expected, why it is not that, and what it probably is."""
    like = await _like(bus, unit, meter)
    hint = f"it answers like {' or '.join(like)}" if like else "check meter, map, unit and word order"
    return WrongDeviceError(f"unit {unit} at {bus.place} is not a {meter.model}: {reason}; {hint}")


async def _like(bus: Bus, unit: int, but: MeterMap) -> list[str]:
    """Return the packaged maps whose voltages, frequency and power factors are all there and plausible."""
    fitting = []
    for name, meter in (await asyncio.to_thread(_packaged)).items():
        if meter == but:
            continue
        try:
            found = await _numbers(bus, unit, meter, meter.checked)
            fits = len(found) == len(meter.checked) and not doubt(meter, found, may_be_off=False)
            if fits and not contradiction(meter, await _numbers(bus, unit, meter, meter.related)):
                fitting.append(f"{meter.maker} {meter.model} (meter: {name})")
        except ConnectError:
            break
        except (DeviceError, ProtocolError):  # of a meter that is another one anyway: no reason to say something else
            continue
    return fitting


@cache
def _packaged() -> dict[MeterName, MeterMap]:
    return {name: packaged_map(name) for name in METERS}


async def _numbers(bus: Bus, unit: int, meter: MeterMap, names: Sequence[str]) -> dict[str, float]:
    """Read those of these values that the meter has, as they stand in the registers."""
    if not names:
        return {}
    reader = Reader(meter, names, unit)
    try:
        row = await reader.read(bus)
    except WrongDeviceError:
        return {}
    except RefusedError as error:
        if error.code == ILLEGAL_FUNCTION:
            return {}
        raise
    return {n: float(v) for n, v in zip(names, row, strict=True) if n not in reader.left_out}
