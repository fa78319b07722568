"""What each make of analyzer calls things: commands and functions as data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

from cellwatt.channel import Channel


@dataclass(frozen=True, slots=True)
class Function:
    """One measured function: the ``channel`` it feeds, SI units per unit of the answer, and its long spelling."""

    channel: Channel
    scale: float = 1.0
    long: str = ""


@dataclass(frozen=True, slots=True)
class Dialect:
    """One family of analyzers.

    ``model`` must occur in the answer to ``*IDN?``. ``select`` are the lines that choose the functions of
    the answer to ``read`` and their order, ``{functions}`` in them is the list; ``selected`` asks for that list
    (both joined by ``separator``). ``integrate`` starts the integrator. ``errors`` takes one entry off the
    error queue. ``functions`` is by short spelling.
    """

    maker: str
    model: str
    functions: Mapping[str, Function]
    select: tuple[str, ...]
    selected: str
    read: str
    integrate: tuple[str, ...]
    errors: str = "SYST:ERR?"
    identify: str = "*IDN?"
    separator: str = ","

    def short(self, name: str) -> str:
        """The short spelling of a function in any spelling; unknown ones in upper case."""
        upper = name.strip().upper()
        return next((short for short, f in self.functions.items() if upper in (short, f.long)), upper)


HMC8015 = Dialect(
    maker="Rohde & Schwarz",
    model="HMC8015",
    functions={
        "URMS": Function(Channel("supply.voltage", "V")),
        "IRMS": Function(Channel("supply.current", "A")),
        "P": Function(Channel("supply.power", "W")),
        "S": Function(Channel("supply.apparent_power", "VA")),
        "Q": Function(Channel("supply.reactive_power", "var")),
        "LAMB": Function(Channel("supply.power_factor", "1"), long="LAMBDA"),
        "PHI": Function(Channel("supply.phase", "rad"), scale=math.radians(1.0)),
        "FU": Function(Channel("supply.frequency", "Hz")),
        "WH": Function(Channel("supply.energy", "J", "counter"), scale=3600.0),
    },
    select=("CHAN1:MEAS:FORM ASC", "CHAN1:MEAS:FUNC {functions}"),
    selected="CHAN1:MEAS:FUNC?",
    read="CHAN1:MEAS:DATA?",
    integrate=("INT:MODE MAN", "INT:STAT ON", "INT:STAR"),
)
"""Firmware 1.403 and newer; from the vendor's own examples and a public C++ driver."""
