"""Cycles of an emulated device, computed in blocks."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

import numpy as np

from cellwatt.arrays import Float

T = TypeVar("T")


class Blocks(Generic[T]):
    """Results of ``compute`` for blocks of ``size`` cycles of ``period`` s; ``compute`` takes their times (n,) s.

    A change of the world takes effect with the next block, or after ``forget``.
    """

    def __init__(self, compute: Callable[[Float], T], period: float, size: int) -> None:
        self._compute = compute
        self._period = period
        self._size = size
        self._made: tuple[int, T] | None = None

    def at(self, cycle: int) -> tuple[T, int]:
        """Return the block's result that holds a cycle, counted from the epoch, and the cycle's index in the block."""
        block, row = divmod(cycle, self._size)
        if self._made is None or self._made[0] != block:
            t = (block * self._size + np.arange(self._size, dtype=np.float64)) * self._period
            self._made = block, self._compute(t)
        return self._made[1], row

    def forget(self) -> None:
        """Discard the block, so that it is computed again."""
        self._made = None
