"""The meter behind the emulator: its measured values and its registers."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from cellwatt.emulation import Signals
from cellwatt_drivers.modbus_meter.meter_map import MeterMap
from cellwatt_drivers.modbus_meter.registers import Block

FREQUENCY = 50.0
_SHARES = (0.5, 0.3, 0.2)
"""Share of the current and power that each phase carries."""


class EmulatedMeter:
    """A meter of one model on the mains of ``supply.power``, ``.voltage`` and ``.current``.

    ``energy`` is the value of its import counter, J; it counts from the first read on.
    """

    def __init__(self, signals: Signals, made: MeterMap, energy: float = 0.0) -> None:
        self.map = made
        self.energy = energy
        self._signals = signals
        self._seen: float | None = None
        self._slots = made.slots(tuple(made.values))
        self._names = tuple(made.values)
        known = [*self._slots, *made.exponents(self._names)]
        self._first, self._end = min(s.address for s in known), max(s.end for s in known)
        self._factors = [v.factor for v in made.values.values()]

    def has(self, address: int, count: int) -> bool:
        """True if all requested registers lie between the first and the last of the meter."""
        return self._first <= address and address + count <= self._end

    def cuts(self, address: int, count: int) -> bool:
        """True if a read covers only a share of a value's registers, or registers without a value."""
        return sum(s.end - s.address for s in self._slots if address <= s.address and s.end <= address + count) < count

    def read(self, t: float, address: int, count: int) -> list[int]:
        """Read ``count`` registers from ``address`` on at t s; registers between values and powers of ten are 0."""
        values, registers = self._measured(t), [0] * (self._end - self._first)
        for slot in self._slots:
            if address < slot.end and slot.address < address + count:
                number = values[self._names[slot.column]] / self._factors[slot.column]
                number = number if slot.kind.startswith("float") else round(number)
                Block((slot,), self.map.word_order).encode((number,), registers, self._first)
        return registers[address - self._first :][:count]

    def _measured(self, t: float) -> Mapping[str, float]:
        now = {name: float(v[0]) for name, v in self._signals.at(np.array([t])).items() if name.startswith("supply.")}
        voltage, current, power = (now.get(f"supply.{q}", 0.0) for q in ("voltage", "current", "power"))
        self.energy += power * max(0.0, t - (t if self._seen is None else self._seen))
        self._seen = t
        found = _electric("supply", voltage, current, power) | {
            "supply.frequency": FREQUENCY,
            "supply.energy_imported": self.energy,
        }
        for phase, share in enumerate(_SHARES, start=1):
            found |= _electric(f"phase_{phase}", voltage, share * current, share * power)
            found[f"phase_{phase}.energy_imported"] = share * self.energy
        return {name: found.get(name, 0.0) for name in self._names}


def _electric(where: str, voltage: float, current: float, power: float) -> dict[str, float]:
    apparent = voltage * current
    reactive = math.sqrt(max(apparent**2 - power**2, 0.0))
    return {
        f"{where}.voltage": voltage,
        f"{where}.current": current,
        f"{where}.power": power,
        f"{where}.apparent_power": apparent,
        f"{where}.reactive_power": reactive,
        f"{where}.power_factor": power / apparent if apparent else 0.0,
        f"{where}.phase": math.atan2(reactive, power),
    }
