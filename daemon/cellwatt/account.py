"""Loss accounting that adds up: expected = received + missed + dropped."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any


@dataclass(slots=True)
class Account:
    """Counts the samples of one source.

    The three sides are counted by three parties, so that the sum is a check and not a definition: the
    driver calls ``expect`` from the device's own numbering, time stamps or poll schedule, and ``miss``
    for what never came; the daemon calls ``receive`` and ``drop`` for what did. ``counters`` holds all
    else (retries, duplicates, late answers, checksum errors, reconnects, merged ticks).
    """

    expected: int = 0
    received: int = 0
    missed: Counter[str] = field(default_factory=Counter)
    dropped: Counter[str] = field(default_factory=Counter)
    counters: Counter[str] = field(default_factory=Counter)

    def expect(self, n: int = 1) -> None:
        """The device made n more samples, or n polls fell due."""
        self.expected += n

    def receive(self, n: int = 1) -> None:
        """n samples entered the record and the chain."""
        self.received += n

    def miss(self, n: int, reason: str) -> None:
        """n samples that were due never arrived (``gap``, ``timeout``, ``merged tick`` …)."""
        if n:
            self.missed[reason] += n

    def late(self, n: int, reason: str) -> None:
        """n samples that were missed for ``reason`` came after all, and are received now."""
        self.missed[reason] -= n
        self.counters["late"] += n

    def drop(self, n: int, where: str) -> None:
        """n samples arrived and were given up at ``where`` (``checksum``, ``recorder queue`` …)."""
        if n:
            self.dropped[where] += n

    def count(self, what: str, n: int = 1) -> None:
        """Count anything else that must be visible."""
        self.counters[what] += n

    @property
    def residue(self) -> int:
        """Samples not accounted for; anything but 0 is an alarm."""
        return self.expected - self.received - self.missed.total() - self.dropped.total()

    def snapshot(self) -> dict[str, Any]:
        """Plain figures for health messages."""
        return {
            "expected": self.expected,
            "received": self.received,
            "missed": {reason: n for reason, n in self.missed.items() if n},
            "dropped": dict(self.dropped),
            "residue": self.residue,
            "counters": dict(self.counters),
        }
