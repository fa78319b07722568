"""The instrument behind the emulator: a command tree, an error queue, a measurement every 100 ms, an integrator."""

from __future__ import annotations

import math
import re
from collections import deque
from collections.abc import Callable, Mapping, Set
from typing import ClassVar

import numpy as np

from cellwatt.emulation import Signals

UPDATE = 0.1
"""Time between two measurements, s; queries in between return the same one."""
NOT_A_NUMBER = 9.91e37
OVERFLOW = 9.9e37
FREQUENCY = 50.0
AFTER_RESET = ("URMS", "IRMS", "P", "FPLL", "URAN", "IRAN", "S", "Q", "LAMB", "PHI")

FUNCTIONS = frozenset(AFTER_RESET) | {"FU", "FI", "WH"}
_SAMPLES = 20  # samples of the signals per update
_MOST_SAMPLES = 2000  # most samples of a longer update, after a long time without a query

NO_HEADER = (-113, "Undefined header")
BAD_PARAMETER = (-224, "Illegal parameter value")


class EmulatedAnalyzer:
    """Executes lines of SCPI. ``overload`` names the functions whose input is too large for the range.

    ``data_query`` occurs in every line that requests measured values.
    """

    data_query: ClassVar[str] = "DATA?"

    def __init__(self, signals: Signals, identification: str) -> None:
        self.identification = identification
        self.functions: tuple[str, ...] = AFTER_RESET
        self.overload: Set[str] = frozenset()
        self.measurements = 0
        self.errors: deque[tuple[int, str]] = deque(maxlen=16)
        self.running = False
        self._signals = signals
        self._update = -1
        self._electric = (0.0, 0.0, 0.0)
        """Rms voltage V, rms current A and mean power W of the last update."""
        self._energy = 0.0  # Wh
        self._tree = [(_pattern(notation), action) for notation, action in self._commands().items()]

    def execute(self, line: str, t: float) -> str | None:
        """Execute one line at t s; return its answer, ``None`` if it has no query."""
        self._advance(t)
        answers: list[str] = []
        path = ""
        for unit in line.strip().split(";"):
            header, _, parameter = unit.strip().partition(" ")
            if not header:
                continue
            if not header.startswith("*"):
                header = header[1:] if header.startswith(":") else path + header
                path = header[: header.rfind(":") + 1]
            answer = self._run(header.upper(), parameter.strip())
            if answer is not None:
                answers.append(answer)
        return ";".join(answers) if answers else None

    def _run(self, header: str, parameter: str) -> str | None:
        for pattern, action in self._tree:
            if pattern.fullmatch(header):
                return action(parameter)
        self.errors.append(NO_HEADER)
        return None

    def _commands(self) -> Mapping[str, Callable[[str], str | None]]:
        return {
            "*IDN?": lambda _: self.identification,
            "*CLS": lambda _: self.errors.clear(),
            "*OPC?": lambda _: "1",
            "*STB?": lambda _: "4" if self.errors else "0",
            "SYSTem:ERRor?": lambda _: self._next_error(),
            "CHANnel1:MEASurement:FORMat": lambda p: self._one_of(p, {"ASC", "ASCII"}),
            "CHANnel1:MEASurement:FUNCtions": self._select,
            "CHANnel1:MEASurement:FUNCtions?": lambda _: ",".join(self.functions),
            "CHANnel1:MEASurement:DATA?": lambda _: self._measured(),
            "INTegrator:MODE": lambda p: self._one_of(p, {"MAN", "MANUAL"}),
            "INTegrator:STATe": lambda p: self._one_of(p, {"ON", "OFF", "1", "0"}),
            "INTegrator:STARt": lambda _: self._integrate(),
        }

    def _next_error(self) -> str:
        code, text = self.errors.popleft() if self.errors else (0, "No error")
        return f'{code},"{text}"'

    def _one_of(self, parameter: str, known: set[str]) -> None:
        if parameter.upper() not in known:
            self.errors.append(BAD_PARAMETER)

    def _select(self, parameter: str) -> None:
        names = tuple(name.strip().upper().replace("LAMBDA", "LAMB") for name in parameter.split(","))
        if parameter and set(names) <= FUNCTIONS:
            self.functions = names
        else:
            self.errors.append(BAD_PARAMETER)

    def _integrate(self) -> None:
        self.running = True

    def _advance(self, t: float) -> None:
        """Advance the measurement and the integrator to the last update before t."""
        update = math.floor(t / UPDATE)
        if update <= self._update:
            return
        passed = 1 if self._update < 0 else update - self._update
        self._update = update
        self.measurements += 1
        self._electric = self._mean(update, 1)
        if self.running:
            *_, power = self._mean(update, passed)
            self._energy += power * passed * UPDATE / 3600.0

    def _mean(self, update: int, updates: int) -> tuple[float, float, float]:
        """Rms voltage V, rms current A and mean power W over the ``updates`` updates up to this one."""
        n = min(_SAMPLES * updates, _MOST_SAMPLES)
        t = (update - updates + (np.arange(n) + 0.5) / n * updates) * UPDATE
        values = self._signals.at(t)
        zero = np.zeros(n)
        voltage, current = values.get("supply.voltage", zero), values.get("supply.current", zero)
        power = values.get("supply.power", zero)
        return math.sqrt(float(np.mean(voltage**2))), math.sqrt(float(np.mean(current**2))), float(np.mean(power))

    def _values(self) -> dict[str, float]:
        return _functions(*self._electric) | {"WH": self._energy}

    def _measured(self) -> str:
        values = self._values()
        return ",".join(self._number(name, values[name]) for name in self.functions)

    def _number(self, name: str, value: float) -> str:
        if name in self.overload:
            value = OVERFLOW
        return f"{value:.6E}" if name == "WH" else f"{value:.4E}"


def _functions(u: float, i: float, p: float) -> dict[str, float]:
    apparent = u * i
    factor = p / apparent if apparent else NOT_A_NUMBER
    reactive = math.sqrt(max(apparent**2 - p**2, 0.0))
    phase = math.degrees(math.atan2(reactive, p)) if apparent else NOT_A_NUMBER
    frequency = FREQUENCY if u else NOT_A_NUMBER
    return {
        "URMS": u, "IRMS": i, "P": p, "S": apparent, "Q": reactive, "LAMB": factor, "PHI": phase,
        "FPLL": frequency, "FU": frequency, "FI": frequency, "URAN": 300.0, "IRAN": 10.0,
    }  # fmt: skip


def _pattern(notation: str) -> re.Pattern[str]:
    """``CHANnel1:DATA?`` as a pattern: each word in its short or its full form, a final 1 is optional."""
    body, query = (notation[:-1], r"\?") if notation.endswith("?") else (notation, "")
    return re.compile(":".join(_word(w) for w in body.split(":")) + query)


def _word(word: str) -> str:
    found = re.fullmatch(r"(\*?[A-Z]+)([a-z]*)(1?)", word)
    assert found is not None
    short, rest, number = found.groups()
    return re.escape(short) + (f"(?:{rest.upper()})?" if rest else "") + ("1?" if number else "")
