"""A meter's registers as a YAML file."""

from __future__ import annotations

from importlib.resources import as_file, files
from pathlib import Path
from typing import Literal, get_args

from pydantic import Field, model_validator

from cellwatt.channel import Channel
from cellwatt.config import read_settings
from cellwatt_drivers.modbus_meter.registers import LONGEST, RegisterType, Slot, WordOrder, width
from cellwatt_drivers.shared.maps import SCALED, ChannelName, MapPart, ScaledUnit

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


class MeterValue(MapPart):
    """One value of a meter."""

    address: int = Field(ge=0, le=65535)
    """Address of its first register on the wire, from 0; manuals that count from 1 or 40001 say one more."""
    unit: ScaledUnit
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
        return self.scale * SCALED[self.unit][1]

    @property
    def counts(self) -> bool:
        """True if it is a counter."""
        return self.unit in {"J", "Wh", "kWh", "MWh"} if self.counter is None else self.counter

    def channel(self, name: str, window: float = 0.0) -> Channel:
        """The channel it feeds; what is an energy but no counter is held, not interpolated.

        Powers are means over ``window`` s.
        """
        unit = SCALED[self.unit][0]
        averaged = window if unit in {"W", "VA", "var"} else 0.0
        return Channel(
            name, unit, "counter" if self.counts else "continuous", "hold" if unit == "J" else None, averaged
        )


class MeterMap(MapPart):
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
            return value.wraps_at * SCALED[value.unit][1]
        kind = value.type or self.type
        return 2.0 ** (16 * width(kind)) * value.factor if kind.startswith("uint") else None


def load_map(path: Path) -> MeterMap:
    """Read a map. Raises ``ConfigError`` with every mistake and its line and column."""
    return read_settings(path, MeterMap)


def chosen_map(name: MeterName | None, path: Path | None) -> MeterMap:
    """Read a map of one's own, or else a packaged one."""
    if path is not None:
        return load_map(path)
    assert name is not None
    return packaged_map(name)


def packaged_map(name: MeterName) -> MeterMap:
    """Read one of ``METERS``."""
    with as_file(files(__package__) / "meters" / f"{name}.yaml") as path:
        return load_map(path)
