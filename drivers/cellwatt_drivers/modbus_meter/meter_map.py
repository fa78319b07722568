"""A meter's registers as a YAML file."""

from __future__ import annotations

import math
from importlib.resources import as_file, files
from pathlib import Path
from typing import Annotated, Literal, get_args

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from cellwatt.channel import Channel
from cellwatt.config import read_settings
from cellwatt_drivers.modbus_meter.registers import LONGEST, RegisterType, Slot, WordOrder, width

MeterName = Literal[
    "eastron_sdm630",
    "gavazzi_em340",
    "schneider_iem3000",
    "schneider_pm5000",
    "shelly_pro_3em",
    "siemens_pac2200",
    "siemens_pac3200",
]
METERS: tuple[MeterName, ...] = get_args(MeterName)
"""Packaged maps."""

ChannelName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*(\.[a-z][a-z0-9_]*)+$")]
MeterUnit = Literal[
    "V", "kV", "A", "mA", "kA", "W", "kW", "MW", "VA", "kVA", "var", "kvar", "J", "Wh", "kWh", "MWh", "Hz", "1", "%",
    "deg", "rad", "degC", "s", "h",
]  # fmt: skip


def _written(unit: object) -> object:
    """A bare 1 is a number in YAML, and the unit of a ratio here."""
    return "1" if type(unit) is int and unit == 1 else unit


_SI: dict[MeterUnit, tuple[str, float]] = {
    "V": ("V", 1.0), "kV": ("V", 1e3), "A": ("A", 1.0), "mA": ("A", 1e-3), "kA": ("A", 1e3),
    "W": ("W", 1.0), "kW": ("W", 1e3), "MW": ("W", 1e6), "VA": ("VA", 1.0), "kVA": ("VA", 1e3),
    "var": ("var", 1.0), "kvar": ("var", 1e3), "J": ("J", 1.0), "Wh": ("J", 3.6e3), "kWh": ("J", 3.6e6),
    "MWh": ("J", 3.6e9), "Hz": ("Hz", 1.0), "1": ("1", 1.0), "%": ("1", 0.01), "deg": ("rad", math.pi / 180),
    "rad": ("rad", 1.0), "degC": ("degC", 1.0), "s": ("s", 1.0), "h": ("s", 3.6e3),
}  # fmt: skip


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


class MeterValue(_Part):
    """One value of a meter."""

    address: int = Field(ge=0, le=65535)
    """Address of its first register on the wire, from 0; manuals that count from 1 or 40001 say one more."""
    unit: Annotated[MeterUnit, BeforeValidator(_written)]
    """Unit of the number, after ``scale``."""
    type: RegisterType | None = None
    """Type in which it is written; left out: the map's ``type``."""
    scale: float = Field(1.0, allow_inf_nan=False)
    """The number in the registers times this is in ``unit``."""
    counter: bool | None = None
    """Counts up: what falls is a wrap or a reset. Left out: yes for an energy."""
    wraps_at: float | None = Field(None, gt=0, allow_inf_nan=False)
    """A counter begins anew at this, in ``unit``; left out: where an unsigned type ends."""
    missing: tuple[int, ...] | None = None
    """Numbers in the registers that stand for no value. Left out: the lowest of a signed integer, the highest of an
    unsigned one."""
    largest: float | None = None
    """A number in the registers beyond this (up or down) stands for an overload."""
    between: tuple[float, float] | None = None
    """In ``unit``: outside of it, the first answer shows that this is another meter or word order. 0 and NaN show it
    for a frequency, and for voltages where no phase has one."""

    @property
    def factor(self) -> float:
        """SI units per unit of the number in the registers."""
        return self.scale * _SI[self.unit][1]

    @property
    def counts(self) -> bool:
        """True if it is a counter."""
        return self.unit in {"J", "Wh", "kWh", "MWh"} if self.counter is None else self.counter

    def channel(self, name: str, window: float = 0.0) -> Channel:
        """The channel it feeds; what is an energy but no counter is held, not interpolated.

        Powers are means over ``window`` s.
        """
        unit = _SI[self.unit][0]
        averaged = window if unit in {"W", "VA", "var"} else 0.0
        return Channel(
            name, unit, "counter" if self.counts else "continuous", "hold" if unit == "J" else None, averaged
        )


class MeterMap(_Part):
    """A make of meter: how its registers are read, and what stands in them."""

    maker: str
    """Maker of the meter."""
    model: str
    """Model of the meter."""
    source: str = ""
    """Source of the addresses, and the ones that are not sure."""
    function: Literal["input", "holding"]
    """Read by function code 4 (``input``) or 3 (``holding``)."""
    both_functions: bool = False
    """The other function reads the same registers."""
    delivered: str = ""
    """Unit, speed and parity that it has at delivery."""
    type: RegisterType
    """Type in which most values are written."""
    word_order: WordOrder = "big"
    """Which word of a value comes first: the high one (``big``) or the low one (``little``)."""
    longest_read: int = Field(LONGEST, ge=4, le=LONGEST)
    """Registers that it gives in one answer."""
    gap: int = Field(0, ge=0, le=LONGEST)
    """Registers between two values that may be read with them, to save a request."""
    window: float = Field(0.0, ge=0)
    """Window in s that each power is a mean over; 0: not known."""
    values: dict[ChannelName, MeterValue] = Field(min_length=1)
    """By channel."""

    @model_validator(mode="after")
    def _apart(self) -> MeterMap:
        end, before = -1, ""
        for name, value in sorted(self.values.items(), key=lambda item: item[1].address):
            if value.address < end:
                raise ValueError(f"values: {name} at {value.address} begins within {before}")
            end, before = value.address + width(value.type or self.type), name
        if end > 65536:
            raise ValueError(f"values: {before} ends beyond register 65535")
        return self

    def slots(self, names: tuple[str, ...]) -> list[Slot]:
        """The named values' places; columns are in the order of ``names``."""
        found = []
        for column, name in enumerate(names):
            value = self.values[name]
            found.append(Slot(value.address, value.type or self.type, column))
        return found

    @property
    def checked(self) -> tuple[str, ...]:
        """Values that tell whether this is the meter."""
        return tuple(name for name, value in self.values.items() if value.between is not None)

    @property
    def factors(self) -> tuple[str, ...]:
        """Power factors of phases, by which it is told whether this is the meter."""
        return tuple(n for n in self.checked if n.startswith("phase_") and n.endswith(".power_factor"))

    @property
    def related(self) -> tuple[str, ...]:
        """Values that the ``factors`` must agree with, and these."""
        phases = [name.removesuffix("power_factor") for name in self.factors]
        wanted = (f"{p}{q}" for p in phases for q in ("voltage", "current", "power", "power_factor"))
        return tuple(name for name in wanted if name in self.values)

    def marks(self, name: str) -> tuple[int, ...]:
        """Return the numbers in the registers that stand for no value."""
        value = self.values[name]
        kind = value.type or self.type
        if value.missing is not None:
            return value.missing
        bits = 16 * width(kind)
        if kind.startswith("uint"):
            return (2**bits - 1,)
        return (-(2 ** (bits - 1)),) if kind.startswith("int") else ()

    def wrap(self, name: str) -> float | None:
        """Return the value at which a counter begins anew, in SI units; ``None`` if that is not known."""
        value = self.values[name]
        if value.wraps_at is not None:
            return value.wraps_at * _SI[value.unit][1]
        kind = value.type or self.type
        return 2.0 ** (16 * width(kind)) * value.factor if kind.startswith("uint") else None


def load_map(path: Path) -> MeterMap:
    """Read a map. Raises ``ConfigError`` with every mistake and its line and column."""
    return read_settings(path, MeterMap)


def packaged_map(name: MeterName) -> MeterMap:
    """Read one of ``METERS``."""
    with as_file(files(__package__) / "meters" / f"{name}.yaml") as path:
        return load_map(path)
