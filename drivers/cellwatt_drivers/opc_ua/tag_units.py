"""Units in which controllers give their tags, and how OPC UA names them."""

from __future__ import annotations

from typing import Final

from cellwatt.channel import UNITS
from cellwatt.units import TABLE, Unit

_KNOWN: Final[dict[str, tuple[str, Unit]]] = {
    **{unit: (unit, Unit(unit)) for unit in sorted(UNITS)},
    **{name: (next(iter(units)), unit) for units in TABLE.values() for name, unit in units.items()},
    **{
        name: (si, Unit(name, factor))
        for name, si, factor in (
            ("%", "1", 0.01),
            ("mV", "V", 1e-3),
            ("kV", "V", 1e3),
            ("kA", "A", 1e3),
            ("MW", "W", 1e6),
            ("kVA", "VA", 1e3),
            ("kvar", "var", 1e3),
            ("MWh", "J", 3.6e9),
            ("ms", "s", 1e-3),
            ("min", "s", 60.0),
            ("h", "s", 3.6e3),
            ("kHz", "Hz", 1e3),
        )
    },
}
NAMES: Final = tuple(_KNOWN)
"""Units that a tag may be in."""

_CODES: Final = {
    "DD": "deg", "C81": "rad", "C25": "mrad", "E96": "deg/s", "2A": "rad/s", "RPM": "rpm", "2B": "rad/s^2",
    "MTR": "m", "MMT": "mm", "MTS": "m/s", "C16": "mm/s", "MSK": "m/s^2", "NEW": "N", "B47": "kN", "NU": "Nm",
    "KGM": "kg", "GRM": "g", "CEL": "degC", "KEL": "K", "FAH": "degF", "PAL": "Pa", "KPA": "kPa", "BAR": "bar",
    "AMP": "A", "4K": "mA", "B22": "kA", "VLT": "V", "2Z": "mV", "KVT": "kV", "WTT": "W", "KWT": "kW", "MAW": "MW",
    "D46": "VA", "KVA": "kVA", "D44": "var", "KVR": "kvar", "JOU": "J", "KJO": "kJ", "3B": "MJ", "WHR": "Wh",
    "KWH": "kWh", "MWH": "MWh", "HTZ": "Hz", "KHZ": "kHz", "SEC": "s", "C26": "ms", "MIN": "min", "HUR": "h",
    "P1": "%", "C62": "1",
}  # fmt: skip
"""By common code of UN/CEFACT recommendation 20, which OPC UA writes as a number."""
_BY_NUMBER: Final = {int.from_bytes(code.encode(), "big"): name for code, name in _CODES.items()}


def si(unit: str) -> tuple[str, Unit]:
    """Return the SI unit of a unit of ``NAMES``, and the unit itself."""
    return _KNOWN[unit]


def named(unit_id: int, text: str) -> str | None:
    """Return the unit that an EUInformation means by its number or its text; ``None`` for one that is not known."""
    written = text.strip().replace("°C", "degC").replace("°", "deg").replace("·", "").replace("²", "^2")
    return _BY_NUMBER.get(unit_id) or (written if written in _KNOWN else None)
