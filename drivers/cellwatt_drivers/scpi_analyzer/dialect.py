"""Commands and functions of each family of analyzers, as data."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

from cellwatt.channel import Channel

Element = Literal["1", "2", "3", "4", "5", "6", "7", "sigma"]


@dataclass(frozen=True, slots=True)
class Function:
    """One measured function: its ``channel``, SI units per unit of the answer, and its long spelling.

    ``word`` is the analyzer's short spelling, if it differs from the name used in the settings.
    """

    channel: Channel
    scale: float = 1.0
    long: str = ""
    word: str = ""


@dataclass(frozen=True, slots=True)
class Dialect:
    """One family of analyzers.

    ``known`` must occur in the answer to ``*IDN?``; if empty, ``model`` must. ``functions`` is by the names used in the
    settings. An ``item`` is a function in the analyzer's notation, with ``{element}`` if the analyzer has several
    inputs.

    ``prepare`` are lines sent on connecting. ``select`` are the lines that choose the items of the answer to ``read``
    and their order: ``{functions}`` in them is the list (joined by ``separator``), ``{count}`` its length, and a line
    with ``{number}`` is sent once for each ``{item}``. ``selected`` asks for that list, or with ``{number}`` for one
    item, and ``count`` for the number of items. If ``selected`` is empty, ``read`` itself holds ``{functions}``.
    ``integrate`` starts the integrator. ``errors`` takes one entry off the error queue, between the lines
    ``before_errors`` and ``after_errors``. ``window`` is the averaging window of each value, s, 0 if it is set at the
    analyzer.
    """

    maker: str
    model: str
    functions: Mapping[str, Function]
    read: str
    select: tuple[str, ...] = ()
    selected: str = ""
    count: str = ""
    integrate: tuple[str, ...] = ()
    errors: str = "SYST:ERR?"
    before_errors: tuple[str, ...] = ()
    after_errors: tuple[str, ...] = ()
    identify: str = "*IDN?"
    known: str = ""
    prepare: tuple[str, ...] = ()
    separator: str = ","
    item: str = "{function}"
    elements: tuple[Element, ...] = ("1",)
    window: float = 0.0

    def short(self, name: str) -> str:
        """The analyzer's short spelling of a function in any spelling; unknown ones in upper case."""
        upper = name.strip().upper()
        for key, function in self.functions.items():
            word = function.word or key
            if upper in (word, function.long):
                return word
        return upper

    def items(self, functions: Sequence[str], element: Element) -> tuple[str, ...]:
        """Items of functions that are named as in the settings."""
        words = [self.functions[name].word or name for name in functions]
        return tuple(self.item.format(function=word, element=element.upper()) for word in words)

    def found(self, item: str) -> str:
        """Convert an item from the analyzer to the notation of ``items``: no header and quotes, in short spelling."""
        function, comma, element = item.strip(' "').split(" ")[-1].partition(",")
        where = element.strip().upper()
        return self.short(function) + comma + ("SIGMA" if where == "SIGM" else where)

    def selection(self, items: Sequence[str]) -> list[str]:
        """The lines that choose items."""
        lines = []
        for line in self.select:
            if "{number}" in line:
                lines += [line.format(number=n, item=item) for n, item in enumerate(items, start=1)]
            else:
                lines.append(line.format(functions=self.separator.join(items), count=len(items)))
        return lines

    def query(self, items: Sequence[str]) -> str:
        """The query for one answer."""
        return self.read.format(functions=self.separator.join(items))


_URMS, _IRMS = Channel("supply.voltage", "V"), Channel("supply.current", "A")
_FACTOR, _FREQUENCY = Channel("supply.power_factor", "1"), Channel("supply.frequency", "Hz")
_POWERS = {
    "P": Function(Channel("supply.power", "W")),
    "S": Function(Channel("supply.apparent_power", "VA")),
    "Q": Function(Channel("supply.reactive_power", "var")),
}
_FURTHER = {
    "LAMB": Function(_FACTOR, long="LAMBDA"),
    "PHI": Function(Channel("supply.phase", "rad"), scale=math.radians(1.0)),
    "FU": Function(_FREQUENCY),
    "WH": Function(Channel("supply.energy", "J", "counter"), scale=3600.0),
}

HMC8015 = Dialect(
    maker="Rohde & Schwarz",
    model="HMC8015",
    functions={"URMS": Function(_URMS), "IRMS": Function(_IRMS), **_POWERS, **_FURTHER},
    select=("CHAN1:MEAS:FORM ASC", "CHAN1:MEAS:FUNC {functions}"),
    selected="CHAN1:MEAS:FUNC?",
    read="CHAN1:MEAS:DATA?",
    integrate=("INT:MODE MAN", "INT:STAT ON", "INT:STAR"),
    window=0.1,
)
"""Firmware 1.403 and newer; from the vendor's examples and a public C++ driver."""

WT300 = Dialect(
    maker="Yokogawa",
    model="WT300",
    known=",WT3",
    functions={"URMS": Function(_URMS, word="U"), "IRMS": Function(_IRMS, word="I"), **_POWERS, **_FURTHER},
    select=(":NUM:FORM ASC", ":NUM:NORM:NUM {count}", ":NUM:NORM:ITEM{number} {item}"),
    selected=":NUM:NORM:ITEM{number}?",
    count=":NUM:NORM:NUM?",
    read=":NUM:NORM:VAL?",
    integrate=(":INTEG:MODE NORM", ":INTEG:STAR"),
    errors=":STAT:ERR?",
    item="{function},{element}",
    elements=("1", "2", "3", "sigma"),
)
"""WT310, WT330 and their E and HC forms; commands as in Intel's yoko-tool, which serves a WT310."""

LMG600 = Dialect(
    maker="ZES Zimmer",
    model="LMG600",
    known=",LMG6",
    functions={
        "URMS": Function(_URMS, word="UTRMS"),
        "IRMS": Function(_IRMS, word="ITRMS"),
        **_POWERS,
        "LAMB": Function(_FACTOR, word="PF"),
        "FU": Function(_FREQUENCY, word="FCYC"),
    },
    prepare=("*ZLANG SHORT",),
    read="INIM;{functions}",
    before_errors=("*ZLANG SCPI",),
    after_errors=("*ZLANG SHORT",),
    separator=";",
    item="{function}{element}?",
    elements=("1", "2", "3", "4", "5", "6", "7"),
)
"""LMG610, LMG640 and LMG670 in their short language; commands as in public programs that read an LMG670."""

Model = Literal["hmc8015", "wt300", "lmg600"]
DIALECTS: Mapping[Model, Dialect] = {"hmc8015": HMC8015, "wt300": WT300, "lmg600": LMG600}
"""Dialects by ``model`` of the settings."""
