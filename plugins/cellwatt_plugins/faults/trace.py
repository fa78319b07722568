"""The newest frames of one arm, kept as long as an interval in them may still be judged."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Nanoseconds = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Trace:
    """n frames: ``time`` (n,) ns rising, ``position`` (n, joints) rad, ``power`` (n,) W; NaN where missing."""

    time: Nanoseconds
    position: Float
    power: Float

    @classmethod
    def empty(cls, joints: int) -> Trace:
        """No frames yet."""
        return cls(np.empty(0, np.int64), np.empty((0, joints)), np.empty(0))

    def __len__(self) -> int:
        return len(self.time)

    def since(self, onset: int) -> Float:
        """Times of the frames, s from ``onset`` (ns)."""
        return np.asarray((self.time - onset) * 1e-9, dtype=np.float64)

    def with_more(self, other: Trace) -> Trace:
        """These frames followed by later ones."""
        return Trace(
            np.concatenate([self.time, other.time]),
            np.concatenate([self.position, other.position]),
            np.concatenate([self.power, other.power]),
        )

    def between(self, start: int, end: int) -> Trace:
        """The frames from ``start`` to ``end`` ns, both included."""
        first, last = np.searchsorted(self.time, start), np.searchsorted(self.time, end, side="right")
        return Trace(self.time[first:last], self.position[first:last], self.power[first:last])
