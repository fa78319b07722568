"""A meter's registers, described in a YAML file."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Literal, get_args

from pydantic import Field, model_validator

from cellwatt.channel import Channel
from cellwatt.config import read_settings
from cellwatt.section import Section
from cellwatt_drivers.modbus_meter.registers import LONGEST, RegisterType, Slot, WordOrder, width
from cellwatt_drivers.shared.maps import SCALED, ChannelName, ScaledUnit

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


class MeterValue(Section):
    """One value of a meter."""

    address: int = Field(ge=0, le=65535)
    """Address of its first register on the wire, from 0; manuals that count from 1 or 40001 give one more."""
    unit: ScaledUnit
    """Unit of the register number times ``scale``."""
    type: RegisterType | None = None
    """Type of the number; omitted: the map's ``type``."""
    scale: float = Field(1.0, allow_inf_nan=False)
    """Factor from the register number to ``unit``."""
    scale_register: int | None = Field(None, ge=0, le=65535)
    """Address of a register (int16) with the power of ten of the number, from -10 to 10, as in SunSpec's meters."""
    counter: bool | None = None
    """The value only rises: a fall is a wrap or a reset. Omitted: yes for an energy."""
    wraps_at: float | None = Field(None, gt=0, allow_inf_nan=False)
    """Value, in ``unit``, at which the counter restarts from 0; omitted: the end of an unsigned type."""
    missing: tuple[int, ...] | None = None
    """Register numbers that mean "no value". Omitted: the lowest of a signed, the highest of an unsigned integer."""
    largest: float | None = None
    """A register number beyond this, positive or negative, means an overload."""
    between: tuple[float, float] | None = None
    """Range in ``unit``: a first answer outside of it means another meter or word order. So do 0 and NaN for a
    frequency, and for voltages if no phase has one."""

    @property
    def factor(self) -> float:
        """SI units per unit of the number in the registers."""
        return self.scale * SCALED[self.unit][1]

    @property
    def counts(self) -> bool:
        """True if it is a counter."""
        return self.unit in {"J", "Wh", "kWh", "MWh"} if self.counter is None else self.counter

    def channel(self, name: str, window: float = 0.0) -> Channel:
        """Channel for the value; an energy that is not a counter is held, not interpolated.

        Powers are means over ``window`` s.
        """
        unit = SCALED[self.unit][0]
        averaged = window if unit in {"W", "VA", "var"} else 0.0
        return Channel(
            name, unit, "counter" if self.counts else "continuous", "hold" if unit == "J" else None, averaged
        )


class MeterMap(Section):
    """A model of meter: how its registers are read, and their contents."""

    maker: str
    """Maker of the meter."""
    model: str
    """Model of the meter."""
    source: str = ""
    """Source of the addresses, and which addresses are unconfirmed."""
    function: Literal["input", "holding"]
    """Function code: 4 (``input``) or 3 (``holding``)."""
    both_functions: bool = False
    """The other function reads the same registers."""
    delivered: str = ""
    """Unit number, speed and parity at delivery."""
    type: RegisterType
    """Type of most values."""
    word_order: WordOrder = "big"
    """First word of a value: the high one (``big``) or the low one (``little``); ``badc`` and ``dcba``: the same, with
    the low byte of each register first."""
    longest_read: int = Field(LONGEST, ge=4, le=LONGEST)
    """Most registers in one answer."""
    gap: int = Field(0, ge=0, le=LONGEST)
    """Most registers between two values that are read in one request."""
    window: float = Field(0.0, ge=0)
    """Averaging window of each power, s; 0: unknown."""
    values: dict[ChannelName, MeterValue] = Field(min_length=1)
    """Values by channel."""

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
        """Register slots of the named values; columns are in the order of ``names``."""
        found = []
        for column, name in enumerate(names):
            value = self.values[name]
            found.append(Slot(value.address, value.type or self.type, column))
        return found

    def exponents(self, names: tuple[str, ...]) -> list[Slot]:
        """Register slots of the powers of ten of the named values; their columns follow those of ``names``."""
        addresses = {a for name in names if (a := self.values[name].scale_register) is not None}
        return [Slot(a, "int16", column) for column, a in enumerate(sorted(addresses), len(names))]

    @property
    def checked(self) -> tuple[str, ...]:
        """Values that show whether the meter is this model."""
        return tuple(name for name, value in self.values.items() if value.between is not None)

    @property
    def factors(self) -> tuple[str, ...]:
        """Power factors of phases, used to check whether the meter is this model."""
        return tuple(n for n in self.checked if n.startswith("phase_") and n.endswith(".power_factor"))

    @property
    def related(self) -> tuple[str, ...]:
        """Values with which the ``factors`` must agree, and the ``factors`` themselves."""
        phases = [name.removesuffix("power_factor") for name in self.factors]
        wanted = (f"{p}{q}" for p in phases for q in ("voltage", "current", "power", "power_factor"))
        return tuple(name for name in wanted if name in self.values)

    def marks(self, name: str) -> tuple[int, ...]:
        """Return the register numbers that mean "no value"."""
        value = self.values[name]
        kind = value.type or self.type
        if value.missing is not None:
            return value.missing
        bits = 16 * width(kind)
        if kind.startswith("uint"):
            return (2**bits - 1,)
        return (-(2 ** (bits - 1)),) if kind.startswith("int") else ()

    def wrap(self, name: str) -> float | None:
        """Return the value at which a counter restarts from 0, in SI units; ``None`` if unknown."""
        value = self.values[name]
        if value.wraps_at is not None:
            return value.wraps_at * SCALED[value.unit][1]
        kind = value.type or self.type
        known = kind.startswith("uint") and value.scale_register is None
        return 2.0 ** (16 * width(kind)) * value.factor if known else None


def chosen_map(name: MeterName | None, path: Path | None) -> MeterMap:
    """Read the map at ``path``, or else the packaged one.

    Raises ``ConfigError`` with every mistake and its line and column.
    """
    return packaged_map(name) if path is None else read_settings(path, MeterMap)


@cache
def packaged_map(name: MeterName | None) -> MeterMap:
    """Read one of ``METERS``."""
    return read_settings(Path(__file__).parent / "meters" / f"{name}.yaml", MeterMap)
