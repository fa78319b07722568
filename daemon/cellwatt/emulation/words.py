"""Faults of emulated devices in words: ``[SOURCE/]KIND:key=value,…``, like ``spring:joint=3,at=20s``."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType
from typing import Any, Final

from cellwatt.config.wording import did_you_mean
from cellwatt.emulation.emulator import Emulator
from cellwatt.emulation.faults import FAULT_KINDS, ONE_SHOT, Fault
from cellwatt.quantity import FRACTION, RADIANS, SECONDS, parse

Change = Mapping[str, float | str]


def _whole(text: str) -> float:
    try:
        return int(text)
    except ValueError:
        raise ValueError("expected a whole number, like '3'") from None


_SECONDS: Final = partial(parse, units=SECONDS, example="20 s")
_ANGLE: Final = partial(parse, units=RADIANS, example="3 deg")

KEYS: Final[Mapping[str, Callable[[str], float | str]]] = MappingProxyType(
    {
        "at": _SECONDS,
        "for": _SECONDS,
        "seconds": _SECONDS,
        "probability": partial(parse, units=FRACTION, example="5 %"),
        "joint": _whole,
        "stiffness": partial(parse, units={"Nm/rad": 1.0}, example="60 Nm/rad"),
        "rest": _ANGLE,
        "offset": _ANGLE,
        "number": _whole,
        "text": str,
        "to": str,
    }
)
"""Keys of all kinds, each with the function that parses its value."""

WORLD: Final[Mapping[str, tuple[str, ...]]] = MappingProxyType(
    {"spring": ("joint", "stiffness", "rest", "at", "for"), "encoder": ("joint", "offset", "at", "for")}
)
"""Changes of the world that all devices of a cell share, with their keys; the first key is required."""

_LATE: Final = frozenset({"delay", "stall", "disconnect", "clock_jump"})
"""Kinds with a length, without which they would have no effect."""
_SOURCE = re.compile(r"([\w.,-]+)/(.*)", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Mishap:
    """A fault on the wire, or a change of the device or its world, that begins ``at`` s after the epoch."""

    at: float
    what: Fault | Change


def keys_of(kind: str, emulator: type[Emulator]) -> tuple[str, ...]:
    """Keys that a kind of fault takes at an emulator; for a change of the device or the world, its value is first."""
    if kind in WORLD:
        return WORLD[kind]
    if kind in emulator.changes:
        return (emulator.changes[kind], "at")
    seconds = ("seconds",) if kind in _LATE else ()
    return (*seconds, "at") if kind in ONE_SHOT else ("probability", *seconds, "at", "for")


def kinds_of(emulator: type[Emulator]) -> tuple[str, ...]:
    """Kinds of faults that an emulator supports."""
    return (*emulator.faults, *emulator.changes, *WORLD)


def addressed(text: str) -> tuple[tuple[str, ...], str]:
    """Split off the comma-separated names of the sources that a fault strikes; none if it names none."""
    found = _SOURCE.fullmatch(text.partition(":")[0])
    return (tuple(found[1].split(",")), text[len(found[1]) + 1 :]) if found else ((), text)


def kind_of(text: str) -> str:
    """Kind of a fault in words."""
    return text.partition(":")[0].strip()


def mishap(text: str, emulator: type[Emulator]) -> Mishap:
    """Parse a fault for an emulator, in words. Raises ``ValueError`` in one line with the nearest match."""
    kind, rest = kind_of(text), text.partition(":")[2]
    known = kinds_of(emulator)
    if kind not in known:
        hint = "" if kind in FAULT_KINDS else did_you_mean(kind, known)
        raise ValueError(f"{emulator.title} cannot inject {kind}{hint or ';'} it can: {', '.join(known)}")
    keys = keys_of(kind, emulator)
    given: dict[str, Any] = dict(_pair(part, kind, keys) for part in rest.split(",") if part.strip())
    ends = given.get("probability") == 0
    needed = keys[0] if kind not in FAULT_KINDS else "seconds" if kind in _LATE and not ends else None
    if needed is not None and needed not in given:
        raise ValueError(f"{kind} needs {needed}, like '{kind}:{needed}=…' (keys: {', '.join(keys)})")
    if kind in FAULT_KINDS:
        at = given.pop("at", 0.0)
        if "for" in given:
            given["duration"] = given.pop("for")
        return Mishap(at, Fault(kind, **given))
    value = given.pop(keys[0])
    if kind in WORLD:
        return Mishap(0.0, {kind: value, **given})
    return Mishap(float(given.get("at", 0.0)), {kind: value})


def _pair(part: str, kind: str, keys: tuple[str, ...]) -> tuple[str, float | str]:
    key, sign, value = (word.strip() for word in part.partition("="))
    if not sign:
        raise ValueError(f"found {part.strip()!r} in the fault {kind}, expected KEY=VALUE (keys: {', '.join(keys)})")
    if key not in keys:
        raise ValueError(f"the fault {kind} has no {key!r}{did_you_mean(key, keys)} (keys: {', '.join(keys)})")
    try:
        return key, KEYS[key](value)
    except ValueError as error:
        raise ValueError(f"found {value!r} as {key} of the fault {kind}: {error}") from None
