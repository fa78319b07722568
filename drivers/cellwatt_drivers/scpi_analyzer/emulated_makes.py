"""The instruments of other makers behind the emulator: a Yokogawa WT310 and a ZES LMG670."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import ClassVar

from cellwatt.emulation import Signals
from cellwatt_drivers.scpi_analyzer.emulated_analyzer import BAD_PARAMETER, EmulatedAnalyzer

_WT300_WORDS = {
    "U": "URMS", "I": "IRMS", "P": "P", "S": "S", "Q": "Q", "LAMB": "LAMB", "LAMBDA": "LAMB", "PHI": "PHI", "FU": "FU",
    "FI": "FI", "WH": "WH",
}  # fmt: skip
_LMG600_WORDS = {"UTRMS": "URMS", "ITRMS": "IRMS", "P": "P", "S": "S", "Q": "Q", "PF": "LAMB", "FCYC": "FU"}
_WT300_AFTER_RESET = ("U,1", "I,1", "P,1")
_ITEM = re.compile(r":?(?:NUM(?:ERIC)?:)?(?:NORM(?:AL)?:)?ITEM([0-9]+)(\??)")
_LMG600_VALUE = re.compile(r"([A-Z]+?)([1-7])\?")


class EmulatedWt310(EmulatedAnalyzer):
    """A WT310: items are chosen one by one, answers to settings have no header."""

    data_query: ClassVar[str] = "VAL?"

    def __init__(self, signals: Signals, identification: str) -> None:
        self.items = list(_WT300_AFTER_RESET)
        self.number = len(self.items)
        super().__init__(signals, identification)

    def _commands(self) -> Mapping[str, Callable[[str], str | None]]:
        shared = super()._commands()
        return {
            "*IDN?": shared["*IDN?"],
            "STATus:ERRor?": shared["SYSTem:ERRor?"],
            "NUMeric:FORMat": lambda p: self._one_of(p, {"ASC", "ASCII"}),
            "NUMeric:NORMal:NUMber": self._set_number,
            "NUMeric:NORMal:NUMber?": lambda _: str(self.number),
            "NUMeric:NORMal:VALue?": lambda _: self._measured(),
            "INTEGrate:MODE": lambda p: self._one_of(p, {"NORM", "NORMAL"}),
            "INTEGrate:STARt": lambda _: self._integrate(),
        }

    def _run(self, header: str, parameter: str) -> str | None:
        item = _ITEM.fullmatch(header)
        if item is None:
            return super()._run(header, parameter)
        at = int(item[1]) - 1
        if item[2]:
            return self.items[at] if at < len(self.items) else "NONE"
        word, _, element = parameter.upper().replace(" ", "").partition(",")
        if word not in _WT300_WORDS or element not in {"", "1"}:
            self.errors.append(BAD_PARAMETER)
            return None
        self.items += ["NONE"] * (at + 1 - len(self.items))
        self.items[at] = f"{word},1"
        return None

    def _set_number(self, parameter: str) -> None:
        if parameter.isdigit() and 1 <= int(parameter) <= 255:
            self.number = int(parameter)
        else:
            self.errors.append(BAD_PARAMETER)

    def _measured(self) -> str:
        values = self._values()
        shown = (self.items + ["NONE"] * self.number)[: self.number]
        return ",".join(self._shown(values, item.partition(",")[0]) for item in shown)

    def _shown(self, values: Mapping[str, float], word: str) -> str:
        if word not in _WT300_WORDS:
            return "NAN"
        name = _WT300_WORDS[word]
        return "INF" if name in self.overload else f"{values[name]:.4E}"


class EmulatedLmg670(EmulatedAnalyzer):
    """An LMG670: after ``*ZLANG SHORT`` each value has its own query, and ``INIM`` latches the newest values."""

    data_query: ClassVar[str] = "INIM"

    def __init__(self, signals: Signals, identification: str) -> None:
        self.short = False
        super().__init__(signals, identification)

    def _commands(self) -> Mapping[str, Callable[[str], str | None]]:
        shared = super()._commands()
        return {name: shared[name] for name in ("*IDN?", "SYSTem:ERRor?")} | {"*ZLANG": self._set_language}

    def _run(self, header: str, parameter: str) -> str | None:
        if self.short:
            if header == "INIM":
                return None
            value = _LMG600_VALUE.fullmatch(header)
            if value is not None and value[1] in _LMG600_WORDS:
                name = _LMG600_WORDS[value[1]]
                return "9.900000E+37" if name in self.overload else f"{self._values()[name]:.6E}"
            if not header.startswith("*"):
                header = ""  # SCPI commands are invalid in the short language
        return super()._run(header, parameter)

    def _set_language(self, parameter: str) -> None:
        self._one_of(parameter, {"SHORT", "SCPI"})
        self.short = parameter.upper() == "SHORT"
