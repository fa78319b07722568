"""Distinguishes a meter from another model by the values of several registers."""

from __future__ import annotations

import asyncio
import math
from collections.abc import Mapping, Sequence

from cellwatt.errors import ConnectError, DeviceError, ProtocolError, WrongDeviceError
from cellwatt_drivers.modbus_meter.meter_map import METERS, MeterMap, packaged_map
from cellwatt_drivers.modbus_meter.reader import Reader
from cellwatt_drivers.shared.modbus import FAILURE, ILLEGAL_FUNCTION, Bus, RefusedError

_LOOKS = 3
"""Consecutive reads that must contain a contradiction."""
_LOADED = 10.0
"""Smallest apparent power of a phase, VA, at which its power factor is checked."""
_BELOW = 0.2
"""Largest amount by which a power factor may be below power over voltage times current."""


def doubt(meter: MeterMap, found: Mapping[str, float], may_be_off: bool) -> str:
    """Return why these first register numbers are not from this meter; empty if they may be.

    A mains meter measures a frequency, and a voltage on at least one phase: 0 or NaN means another meter, unless the
    mains ``may_be_off``. Values without a range in the map are not checked.
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
            listed = ", ".join(f"{n} reads {values[n]:g}" for n in due)
            return f"{what}: {listed}"
    return ""


def contradiction(meter: MeterMap, found: Mapping[str, float]) -> str:
    """Return which of these register numbers contradict each other; empty if none do.

    A phase's power factor is its power over voltage times current, or the cosine of its angle, which is higher if the
    current has harmonics: one that is clearly lower comes from another meter's register.
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
    """Raise ``WrongDeviceError`` if the meter is not the map's model; it names the actual model if possible.

    ``found`` are values already read; if it has no voltage or no frequency, they are read here.
    """
    known = {_quantity(meter, name) for name in found}
    unread = [name for name in meter.checked if _quantity(meter, name) not in known]
    found = {**found, **await _numbers(bus, unit, meter, unread)}
    if reason := doubt(meter, found, may_be_off):
        raise await wrong(bus, unit, meter, reason)
    for _ in range(_LOOKS):  # the load may change between the reads of two registers
        found = await _numbers(bus, unit, meter, meter.related)
        reason = contradiction(meter, found)
        if not reason:
            return
    raise await wrong(bus, unit, meter, reason)


def _quantity(meter: MeterMap, name: str) -> str:
    return meter.values[name].unit.removeprefix("k")


async def wrong(bus: Bus, unit: int, meter: MeterMap, reason: str) -> WrongDeviceError:
    """Return the error with the expected meter, the contradiction, and the probable model."""
    like = await _like(bus, unit, meter)
    advice = "check meter, map (addresses count from 0), unit and word order"
    hint = f"it answers like {' or '.join(like)}" if like else advice
    return WrongDeviceError(f"unit {unit} at {bus.place} is not a {meter.model}: {reason}; {hint}")


async def _like(bus: Bus, unit: int, but: MeterMap) -> list[str]:
    """Return the packaged maps for which voltages, frequency and power factors are all present and plausible."""
    fitting = []
    for name in METERS:
        meter = await asyncio.to_thread(packaged_map, name)
        if meter == but:
            continue
        try:
            found = await _numbers(bus, unit, meter, meter.checked)
            fits = len(found) == len(meter.checked) and not doubt(meter, found, may_be_off=False)
            if fits and not contradiction(meter, await _numbers(bus, unit, meter, meter.related)):
                fitting.append(f"{meter.maker} {meter.model} (meter: {name})")
        except ConnectError:
            break
        except (DeviceError, ProtocolError):  # this map does not fit; the meter is wrong in any case
            continue
    return fitting


async def _numbers(bus: Bus, unit: int, meter: MeterMap, names: Sequence[str]) -> dict[str, float]:
    """Read the register numbers of those values that the meter has."""
    if not names:
        return {}
    reader = Reader(meter, names, unit)
    try:
        row = await reader.read(bus)
    except WrongDeviceError:
        return {}
    except RefusedError as error:
        if error.code in (ILLEGAL_FUNCTION, FAILURE):
            return {}
        raise
    return {n: float(v) for n, v in zip(names, row, strict=True) if n not in reader.left_out}
