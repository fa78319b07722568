"""Building blocks of YAML files that assign a device's values to channels, with their units."""

from __future__ import annotations

from typing import Annotated, Final

from pydantic import AfterValidator, BeforeValidator, Field

from cellwatt.channel import UNITS
from cellwatt.config.wording import did_you_mean
from cellwatt.units import TABLE, Unit

ChannelName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)+$")]

KNOWN: Final[dict[str, tuple[str, Unit]]] = {
    **{unit: (unit, Unit(unit)) for unit in sorted(UNITS)},
    **{name: (next(iter(units)), unit) for units in TABLE.values() for name, unit in units.items()},
    **{
        name: (si, Unit(name, factor))
        for si, names in {
            "1": {"%": 0.01},
            "V": {"mV": 1e-3, "kV": 1e3},
            "A": {"kA": 1e3},
            "W": {"MW": 1e6},
            "VA": {"kVA": 1e3},
            "var": {"kvar": 1e3},
            "J": {"MWh": 3.6e9},
            "s": {"ms": 1e-3, "min": 60.0, "h": 3.6e3},
            "Hz": {"kHz": 1e3},
        }.items()
        for name, factor in names.items()
    },
}
"""Units in which devices deliver values: the SI unit of each, and the unit itself."""
SCALED: Final = {name: (si, unit.factor) for name, (si, unit) in KNOWN.items() if not unit.zero}
"""Units of ``KNOWN`` with the same zero as SI: the SI unit, and SI units per unit."""


def _written(unit: object) -> object:
    """Convert a bare 1, a number in YAML, to the unit of a ratio."""
    return "1" if type(unit) is int and unit == 1 else unit


def _known(unit: str) -> str:
    if unit not in KNOWN:
        raise ValueError(f"{unit!r} is not a unit{did_you_mean(unit, KNOWN)} (there are: {', '.join(KNOWN)})")
    return unit


def _scaled(unit: str) -> str:
    if unit not in SCALED:
        raise ValueError(f"{unit!r} has a different zero than {KNOWN[unit][0]}")
    return unit


AnyUnit = Annotated[str, BeforeValidator(_written), AfterValidator(_known)]
"""One of ``KNOWN``."""
ScaledUnit = Annotated[AnyUnit, AfterValidator(_scaled)]
"""One of ``SCALED``."""
