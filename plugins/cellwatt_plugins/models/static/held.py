"""Recognises the poses that an arm holds, from its encoders alone."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.batch import Float

STILL: Final = 5e-4
"""rad: an arm whose joints all stay within this of where they stopped is at rest."""
SETTLE: Final = 0.5
"""s at rest before the torque counts."""
HOLD: Final = 2.0
"""s over which it is averaged."""
HOLE: Final = 0.25
"""s without a sample, after which the pose is not held any more."""


@dataclass(frozen=True)
class HeldPose:
    """One pose, held. ``start`` and ``end`` ns of the samples that count, (n,) each below, angles in rad."""

    start: int
    end: int
    count: int
    q: Float
    torque: Float
    """Mean over the samples, in the unit that was given."""
    spread: Float
    """Standard deviation of the single samples."""
    approach: Float
    """The way each joint came since it last turned round; NaN where it has not been seen to move."""


@dataclass
class Recogniser:
    """Takes samples as they come, in blocks cut anywhere, and gives each pose once, when it has been held long enough.

    ``joints`` is their number n. ``too_short`` counts rests that ended after ``settle`` and before ``hold``.
    """

    joints: int
    still: float = STILL
    settle: float = SETTLE
    hold: float = HOLD
    too_short: int = 0
    _anchor: Float | None = None
    _since: int = 0
    _last: int = 0
    _told: bool = False
    _kept: deque[tuple[Float, Float]] = field(default_factory=deque)
    _first: int = 0
    _way: _Way | None = None

    def update(self, time: NDArray[np.int64], q: Float, torque: Float) -> list[HeldPose]:
        """Poses that are complete with the next samples: times (k,) ns, ``q`` and ``torque`` (k, n).

        Samples with a missing value are passed over.
        """
        whole = np.isfinite(q).all(axis=1) & np.isfinite(torque).all(axis=1)
        found = (self._sample(int(t), a, b) for t, a, b in zip(time[whole], q[whole], torque[whole], strict=True))
        return [pose for pose in found if pose is not None]

    def _sample(self, time: int, q: Float, torque: Float) -> HeldPose | None:
        if self._way is None:
            self._way = _Way(q, self.still)
        self._way.follow(q)
        late = time - self._last > HOLE * 1e9 or time < self._last
        moved = self._anchor is None or bool(np.max(np.abs(q - self._anchor)) > self.still)
        self._last = time
        if moved or late:
            self.too_short += moved and bool(self._kept)
            self._since, self._told = time, self._told and not moved
            self._anchor = q if moved else self._anchor
            self._kept.clear()
            return None
        if self._told or time - self._since < self.settle * 1e9:
            return None
        if not self._kept:
            self._first = time
        self._kept.append((q, torque))
        return self._complete(time) if time - self._first >= self.hold * 1e9 - 1e6 else None

    def _complete(self, time: int) -> HeldPose:
        assert self._way is not None
        q, torque = (np.stack(values) for values in zip(*self._kept, strict=True))
        self._kept.clear()
        self._told = True
        spread = torque.std(axis=0, ddof=1) if len(torque) > 1 else np.full(self.joints, np.nan)
        mean = q.mean(axis=0)
        return HeldPose(self._first, time, len(q), mean, torque.mean(axis=0), spread, self._way.travelled(mean))


class _Way:
    """Angles at which each joint last turned round; back and forth within ``slack`` rad is no turn."""

    def __init__(self, q: Float, slack: float) -> None:
        self._slack = slack
        self._turned = np.full(len(q), np.nan)
        self._furthest = q.copy()
        self._sign = np.zeros(len(q))

    def follow(self, q: Float) -> None:
        """The next angles (n,)."""
        ahead = (q - self._furthest) * self._sign
        moved = np.abs(q - self._furthest) > self._slack
        turn = moved & ((ahead < 0) | (self._sign == 0))
        self._turned = np.where(turn, self._furthest, self._turned)
        self._sign = np.where(turn, np.sign(q - self._furthest), self._sign)
        self._furthest = np.where(turn | (ahead > 0), q, self._furthest)

    def travelled(self, q: Float) -> Float:
        """From the last turn to ``q``, (n,) rad; NaN where a joint has not moved."""
        return np.where(self._sign == 0, np.nan, q - self._turned)
