"""Counts that never fall, made of counts that begin anew or are taken back. Pure."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Final

MOST: Final = 50_000
"""Counts that are remembered; what is beyond is told as it is counted."""


@dataclass(slots=True)
class _Mark:
    life: Hashable
    before: float
    top: float


class Ratchet:
    """Totals by key over several lives of the part that counts."""

    def __init__(self) -> None:
        self._marks: dict[Hashable, _Mark] = {}

    def total(self, key: Hashable, value: float, life: Hashable = None) -> float:
        """Total of a count that shows ``value`` now.

        Where ``life`` is another than before, or is ``None`` and the count fell, it has begun anew at 0; within a life
        the highest value counts, since samples that arrive late are taken back.
        """
        mark = self._marks.get(key)
        if mark is None and len(self._marks) >= MOST:
            return value
        if mark is None:
            mark = self._marks[key] = _Mark(life, 0.0, value)
        elif mark.life != life or (life is None and value < mark.top):
            mark.before, mark.life, mark.top = mark.before + mark.top, life, value
        else:
            mark.top = max(mark.top, value)
        return mark.before + mark.top


class Lives:
    """Numbers the lives of parts: one ends when its process is another one or its steady count falls."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[int, int | None, float]] = {}

    def life(self, part: str, process: int | None, steady: float) -> int:
        """Number of the part's life, by the ``process`` id it runs in and a count that only a new life lowers."""
        number, before, last = self._known.get(part, (0, process, 0.0))
        number += process != before or steady < last
        self._known[part] = number, process, steady
        return number
