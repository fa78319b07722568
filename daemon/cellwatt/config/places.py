"""Places in a settings file, and the order in which mistakes are reported."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from cellwatt.errors import Problem

KeyPath = tuple[str | int, ...]
"""Keys and list indices from the top of the file."""

MOST = 20
"""Mistakes that are told of one file; of others only that there are more."""

_PLACE = re.compile(r"(.*):(\d+):(\d+)", re.DOTALL)


class Mark(NamedTuple):
    """A position in the text, both from 1."""

    line: int
    column: int


@dataclass(frozen=True, slots=True)
class Location:
    """Place of a value and its key; ``written`` is the text of a scalar as it stands in the file, else ``""``.

    ``span`` holds the characters of the value, with anchor and tag.
    """

    key: Mark
    value: Mark
    written: str
    span: tuple[int, int] = (0, 0)


class Position(NamedTuple):
    """A problem's place in parts; no line and column where it concerns the whole file."""

    file: str
    line: int | None
    column: int | None


def dotted(path: KeyPath) -> str:
    """A key path as people write it: ``zenoh.connect[0]``; on one line, whatever the keys hold."""
    text = ""
    for part in path:
        key = part if isinstance(part, int) or part.isprintable() else repr(part)
        text += f"[{part}]" if isinstance(part, int) else f".{key}"
    return text.removeprefix(".")


def position(problem: Problem) -> Position:
    """File, line and column of a problem."""
    match = _PLACE.fullmatch(problem.place)
    if match is None:
        return Position(problem.place, None, None)
    return Position(match[1], int(match[2]), int(match[3]))


def ordered(problems: Iterable[Problem]) -> list[Problem]:
    """Problems by file, line and column, each told once; what concerns a whole file comes last."""

    def key(problem: Problem) -> tuple[str, float, float]:
        file, line, column = position(problem)
        return file, line or math.inf, column or math.inf

    return sorted(dict.fromkeys(problems), key=key)


def first(problems: Iterable[Problem]) -> list[Problem]:
    """The first problems of one file in order, and that there are more, where it has some."""
    found = ordered(problems)
    closing = [Problem(position(found[0]).file, "", "and more")] if len(found) > MOST else []
    return found[:MOST] + closing
