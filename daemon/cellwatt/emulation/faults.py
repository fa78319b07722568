"""Fault scripts for emulators, with exact counts of what was injected."""

from __future__ import annotations

import random
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

FaultKind = Literal[
    "delay", "reorder", "duplicate", "loss", "garbage", "half_frame", "stall", "disconnect", "clock_jump"
]
FAULT_KINDS: tuple[FaultKind, ...] = get_args(FaultKind)

ONE_SHOT: frozenset[FaultKind] = frozenset({"stall", "disconnect", "clock_jump"})
"""Kinds that strike once when injected; the others strike each frame with their probability until they end."""


@dataclass(frozen=True, slots=True)
class Fault:
    """A fault of an emulated device.

    ``probability`` per frame (not used by one-shot kinds); ``seconds``: length of a delay, stall or outage, or of the
    clock's jump; ``duration``: s after which the fault ends (0: never).
    """

    kind: FaultKind
    probability: float = 1.0
    seconds: float = 0.0
    duration: float = 0.0


class Injector:
    """Decides frame by frame which faults strike, and counts those that did.

    Tests compare a driver's counters with ``counts``. ``now`` is s of the monotonic clock.
    """

    def __init__(self, seed: int = 0) -> None:
        self._random = random.Random(seed)
        self._active: dict[FaultKind, tuple[Fault, float]] = {}
        self._once: list[Fault] = []
        self.counts: Counter[str] = Counter()

    def inject(self, fault: Fault, now: float) -> None:
        """Begin a fault (``probability`` 0 ends that kind)."""
        if fault.kind in ONE_SHOT:
            self._once.append(fault)
        elif fault.probability <= 0:
            self._active.pop(fault.kind, None)
        else:
            end = now + fault.duration if fault.duration else float("inf")
            self._active[fault.kind] = (fault, end)

    def strikes(self, kind: FaultKind, now: float) -> Fault | None:
        """The fault of this kind that strikes a frame sent ``now``, or ``None``; a strike is counted."""
        entry = self._active.get(kind)
        if entry is None:
            return None
        fault, end = entry
        if now >= end:
            del self._active[kind]
            return None
        if self._random.random() >= fault.probability:
            return None
        self.counts[kind] += 1
        return fault

    def left_of(
        self, frame: bytes, cut: Callable[[bytes], int] = len, garbage: Callable[[bytes], bytes] = bytes
    ) -> tuple[list[bytes], bool, float]:
        """Apply ``loss``, ``half_frame``, ``delay``, ``garbage`` and ``duplicate`` to a frame that is sent now.

        Returns the pieces in order, whether the frame is whole, and its delay, s. A half frame is shorter than ``cut``
        of the frame (default: its length); ``garbage`` makes the random bytes that go first fit for the wire.
        """
        now = time.monotonic()
        if self.strikes("loss", now):
            return [], False, 0.0
        if self.strikes("half_frame", now):
            return [frame[: 1 + self.below(cut(frame) - 1)]], False, 0.0
        late = self.strikes("delay", now)
        ahead = [garbage(self.random_bytes(1, 40))] if self.strikes("garbage", now) else []
        again = [frame] if self.strikes("duplicate", now) else []
        return [*ahead, frame, *again], True, late.seconds if late else 0.0

    def once(self, kind: FaultKind) -> Fault | None:
        """The next pending one-shot fault of this kind, or ``None``; counted when taken."""
        for i, fault in enumerate(self._once):
            if fault.kind == kind:
                del self._once[i]
                self.counts[kind] += 1
                return fault
        return None

    def random_bytes(self, low: int, high: int) -> bytes:
        """Between ``low`` and ``high`` bytes of garbage."""
        return self._random.randbytes(self._random.randint(low, high))

    def chance(self) -> float:
        """Return a repeatable random number in 0 … 1."""
        return self._random.random()

    def below(self, n: int) -> int:
        """A repeatable random number in 0 … n-1."""
        return self._random.randrange(n)
