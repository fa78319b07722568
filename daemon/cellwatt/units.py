"""Units for display and export, and the one table of their factors to SI.

Inside cellwatt, in recordings and in messages every value is in its SI unit. Plots, printed tables and exports may use
another unit, chosen by the settings' ``units`` or by ``--units``.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cellwatt.section import Section


@dataclass(frozen=True, slots=True)
class Unit:
    """A unit: its name, its size in the SI unit, and the value on its scale at zero of the SI unit."""

    name: str
    factor: float = 1.0
    zero: float = 0.0

    def of(self, values: ArrayLike) -> NDArray[np.float64]:
        """Convert values from the SI unit to this unit, any shape."""
        shown = np.asarray(values, np.float64) / self.factor
        return shown + self.zero if self.zero else shown  # adding 0 would turn −0 into 0

    def si(self, values: ArrayLike) -> NDArray[np.float64]:
        """Convert values from this unit to the SI unit, any shape."""
        return (np.asarray(values, np.float64) - self.zero) * self.factor


_ANGLES: Final = (Unit("rad"), Unit("mrad", 1e-3), Unit("deg", math.pi / 180))
_OF: Final[Mapping[str, tuple[Unit, ...]]] = {
    "energy": (Unit("J"), Unit("kJ", 1e3), Unit("MJ", 1e6), Unit("Wh", 3.6e3), Unit("kWh", 3.6e6)),
    "power": (Unit("W"), Unit("mW", 1e-3), Unit("kW", 1e3)),
    "angle": _ANGLES,
    "angular_velocity": (*(Unit(f"{u.name}/s", u.factor) for u in _ANGLES), Unit("rpm", 2 * math.pi / 60)),
    "angular_acceleration": tuple(Unit(f"{u.name}/s^2", u.factor) for u in _ANGLES),
    "torque": (Unit("Nm"), Unit("mNm", 1e-3), Unit("kNm", 1e3)),
    "force": (Unit("N"), Unit("kN", 1e3)),
    "length": (Unit("m"), Unit("mm", 1e-3)),
    "velocity": (Unit("m/s"), Unit("mm/s", 1e-3)),
    "current": (Unit("A"), Unit("mA", 1e-3)),
    "mass": (Unit("kg"), Unit("g", 1e-3)),
    "pressure": (Unit("Pa"), Unit("kPa", 1e3), Unit("bar", 1e5)),
    "temperature": (Unit("degC"), Unit("K", 1.0, 273.15), Unit("degF", 5 / 9, 32.0)),
}
TABLE: Final[Mapping[str, Mapping[str, Unit]]] = {kind: {u.name: u for u in units} for kind, units in _OF.items()}
"""Units of each quantity by name, the SI unit first; no two quantities share a unit name."""
CEFACT: Final[Mapping[str, int]] = {
    name: int.from_bytes(code.encode(), "big")
    for name, code in {
        "rad": "C81", "mrad": "C25", "deg": "DD", "rad/s": "2A", "deg/s": "E96", "rpm": "RPM", "rad/s^2": "2B",
        "m": "MTR", "mm": "MMT", "m/s": "MTS", "mm/s": "C16", "m/s^2": "MSK", "N": "NEW", "kN": "B47", "Nm": "NU",
        "kg": "KGM", "g": "GRM", "degC": "CEL", "K": "KEL", "degF": "FAH", "Pa": "PAL", "kPa": "KPA", "bar": "BAR",
        "A": "AMP", "mA": "4K", "kA": "B22", "V": "VLT", "mV": "2Z", "kV": "KVT", "W": "WTT", "kW": "KWT",
        "MW": "MAW", "VA": "D46", "kVA": "KVA", "var": "D44", "kvar": "KVR", "J": "JOU", "kJ": "KJO", "MJ": "3B",
        "Wh": "WHR", "kWh": "KWH", "MWh": "MWH", "Hz": "HTZ", "kHz": "KHZ", "s": "SEC", "ms": "C26", "min": "MIN",
        "h": "HUR", "%": "P1", "1": "C62",
    }.items()
}  # fmt: skip
"""Common codes of UN/CEFACT recommendation 20, as the numbers by which OPC UA names units."""
_KINDS: Final = {name: kind for kind, units in TABLE.items() for name in units}
_WRITTEN: Final = {name.casefold(): name for name in _KINDS}


class Units(Section):
    """Units for display and export; recordings and messages always use SI units."""

    energy: Literal["J", "kJ", "MJ", "Wh", "kWh"] = "J"
    """Energy."""
    power: Literal["W", "mW", "kW"] = "W"
    """Power."""
    angle: Literal["rad", "mrad", "deg"] = "rad"
    """Position of a joint."""
    angular_velocity: Literal["rad/s", "mrad/s", "deg/s", "rpm"] = "rad/s"
    """Velocity of a joint."""
    angular_acceleration: Literal["rad/s^2", "mrad/s^2", "deg/s^2"] = "rad/s^2"
    """Acceleration of a joint."""
    torque: Literal["Nm", "mNm", "kNm"] = "Nm"
    """Torque."""
    force: Literal["N", "kN"] = "N"
    """Force."""
    length: Literal["m", "mm"] = "m"
    """Position of the tool."""
    velocity: Literal["m/s", "mm/s"] = "m/s"
    """Velocity of the tool."""
    current: Literal["A", "mA"] = "A"
    """Electric current."""
    mass: Literal["kg", "g"] = "kg"
    """Mass."""
    pressure: Literal["Pa", "kPa", "bar"] = "Pa"
    """Pressure."""
    temperature: Literal["degC", "K", "degF"] = "degC"
    """Temperature."""

    def of(self, si: str) -> Unit:
        """Unit in which values of the unit ``si`` are shown; ``si`` itself if no other is available."""
        kind = _KINDS.get(si)
        return Unit(si) if kind is None else TABLE[kind][getattr(self, kind)]

    def but(self, names: Iterable[str]) -> Units:
        """These units with those of ``names`` replaced; ``SI`` resets all to SI. Raises ``ValueError``."""
        chosen = self
        for name in names:
            if name == "SI":
                chosen = Units()
                continue
            kind = kind_of(name)
            if kind is None:
                raise ValueError(f"no unit {name!r}: expected SI, or any of {', '.join(_KINDS)}")
            chosen = chosen.model_copy(update={kind: _WRITTEN[name.casefold()]})
        return chosen


def kind_of(name: str) -> str | None:
    """Quantity that a unit measures, ignoring case but that of m and M; None if ``TABLE`` has no such unit."""
    written = _WRITTEN.get(name.casefold(), name)
    return _KINDS.get(written) if written[:1] == name[:1] or name[:1] not in ("m", "M") else None


def named(name: str) -> Unit | None:
    """Unit by its name; None if it is not in the table."""
    return TABLE[_KINDS[name]][name] if name in _KINDS else None


_OTHERS: Final = {"s": "s", "ms": "ms", "percent": "%", "Hz": "Hz", "rpm": "rpm", "bytes": "bytes"}
"""Units of figures that no quantity in the table has, by their name in a key."""


def figure_named(key: str) -> tuple[str, str]:
    """Name and unit of a figure by its key: ``power residual``, ``W`` for ``power_residual_W``; no unit: ``""``."""
    name, _, last = key.rpartition("_")
    unit = _OTHERS.get(last) or (last if named(last) is not None else "")
    return (name if unit and name else key).replace("_", " "), unit if name else ""


def factors(kind: str) -> dict[str, float]:
    """Factor to SI of each unit of a quantity, by unit name, the SI unit first."""
    return {name: unit.factor for name, unit in TABLE[kind].items()}
