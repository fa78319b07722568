"""Names, units and kinds of what a source measures."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Literal

Kind = Literal["continuous", "discrete", "counter"]
Align = Literal["linear", "average", "hold"]

UNITS = frozenset(
    [
        *("1", "rad", "rad/s", "rad/s^2", "Nm", "Nm/s", "N", "m", "m/s", "m/s^2", "kg", "kg/m^3", "Pa"),
        *("A", "V", "W", "VA", "var", "J", "s", "Hz", "degC", "ohm"),
    ]
)
"""SI units that may leave a driver; raw device units stop at its ``wire.py``."""


class Quality(IntEnum):
    """Quality of one sample. Higher is worse; merging takes the maximum."""

    GOOD = 0
    INTERPOLATED = 1
    LATE = 2
    CLIPPED = 3
    MISSING = 4


@dataclass(frozen=True, slots=True)
class Channel:
    """One measured quantity.

    ``name`` is dotted and lower case (``joint_1.position``, ``supply.power``), ``unit`` one of ``UNITS``.
    ``align`` is the method of alignment to the frame grid; by default power is averaged over the grid
    step (anti-aliased), discrete and counter values are held, others are interpolated linearly.
    ``window`` is the time in s over which the device averages each value, by its manual or its setup; 0 for an
    instantaneous value or if unknown.
    """

    name: str
    unit: str
    kind: Kind = "continuous"
    align: Align | None = None
    window: float = 0.0

    def __post_init__(self) -> None:
        if self.unit not in UNITS:
            raise ValueError(f"channel {self.name}: unit {self.unit!r} is not one of {', '.join(sorted(UNITS))}")

    @property
    def method(self) -> Align:
        """The alignment method in force."""
        if self.align is not None:
            return self.align
        if self.kind != "continuous":
            return "hold"
        return "average" if self.unit in {"W", "VA", "var"} else "linear"


@dataclass(frozen=True, slots=True)
class Stream:
    """Channels that one source delivers together, declared once.

    ``rate`` is the nominal rate in Hz (0 if the source sends on change). ``clock`` is ``device`` if the
    samples carry the device's own time, ``host`` if the daemon stamps them.
    """

    name: str
    channels: tuple[Channel, ...]
    rate: float
    clock: Literal["device", "host"]

    @property
    def names(self) -> tuple[str, ...]:
        """Channel names in column order."""
        return tuple(c.name for c in self.channels)
