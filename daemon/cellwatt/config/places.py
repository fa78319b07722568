"""Positions in a settings file, and the order in which problems are reported."""

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
"""Largest number of problems reported per file; if there are more, the last line is "and more"."""

_PLACE = re.compile(r"(.*):(\d+):(\d+)", re.DOTALL)


class Mark(NamedTuple):
    """A position in the text, both from 1."""

    line: int
    column: int


NOWHERE = Mark(0, 0)
"""The position of a value in a file whose text was not searched for it."""


NOWHERE = Mark(0, 0)
"""Position of a value in a file that was read without positions."""


@dataclass(frozen=True, slots=True)
class Location:
    """Positions of a value and of its key; ``written`` is the text of a scalar in the file, else ``""``.

    ``span``: start and end index of the value in the text, including anchor and tag.
    """

    key: Mark
    value: Mark
    written: str
    span: tuple[int, int] = (0, 0)


class Position(NamedTuple):
    """File, line and column of a problem; line and column are None if it concerns the whole file."""

    file: str
    line: int | None
    column: int | None


def dotted(path: KeyPath) -> str:
    """A key path as text: ``zenoh.connect[0]``; always one line, as unprintable keys are escaped."""
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
    """Problems without duplicates, by file, line and column; problems of a whole file come last."""

    def key(problem: Problem) -> tuple[str, float, float]:
        file, line, column = position(problem)
        return file, line or math.inf, column or math.inf

    return sorted(dict.fromkeys(problems), key=key)


def first(problems: Iterable[Problem]) -> list[Problem]:
    """The first ``MOST`` problems of one file in order, and "and more" if there are others."""
    found = ordered(problems)
    closing = [Problem(position(found[0]).file, "", "and more")] if len(found) > MOST else []
    return found[:MOST] + closing
