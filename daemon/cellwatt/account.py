"""Loss accounting: expected = received + missed + dropped, plus owed for outlets whose peer may lag."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from typing import Any


@dataclass(slots=True)
class Account:
    """Counts the samples of one source.

    Driver and daemon count independently, so that the sum is a check and not a definition: the driver calls
    ``expect`` from the device's own numbering, time stamps or poll schedule, and ``miss`` for samples that never
    arrived (``lose``: both at once); the daemon calls ``receive`` and ``drop`` for those that did. ``counters`` holds
    everything else (retries, duplicates, late answers, checksum errors, reconnects, merged ticks). Counters that
    indicate a disturbed or forged line are also named in ``anomalies`` and ``forgeries``: health warns when they grow.
    """

    expected: int = 0
    received: int = 0
    missed: Counter[str] = field(default_factory=Counter)
    dropped: Counter[str] = field(default_factory=Counter)
    owed: int = 0
    """Rows produced that are neither delivered to the peer of an outlet nor given up yet."""
    counters: Counter[str] = field(default_factory=Counter)
    anomalies: set[str] = field(default_factory=set)
    """Counters of events that are rare on a good line: health warns when they exceed a share of the samples."""
    forgeries: set[str] = field(default_factory=set)
    """Counters of events that never occur on a good line: health warns of the first one."""

    def expect(self, n: int = 1) -> None:
        """Count n samples that the device made, or n polls that fell due."""
        self.expected += n

    def receive(self, n: int = 1) -> None:
        """Count n samples that entered the record and the stages."""
        self.received += n

    def miss(self, n: int, reason: str) -> None:
        """Count n samples that were due and never arrived (``gap``, ``timeout``, ``merged tick`` …)."""
        if n:
            self.missed[reason] += n

    def lose(self, n: int, reason: str) -> None:
        """Count n samples that were due, or made, and never arrived: ``expect`` and ``miss`` in one."""
        self.expect(n)
        self.miss(n, reason)

    def late(self, n: int, reason: str) -> None:
        """Uncount n samples that were counted as missed for ``reason``: they arrived late and count as received."""
        self.missed[reason] -= n
        self.anomaly("late", n)

    def drop(self, n: int, where: str) -> None:
        """Count n samples that arrived and were dropped at ``where`` (``checksum``, ``recorder queue`` …)."""
        if n:
            self.dropped[where] += n

    def count(self, what: str, n: int = 1) -> None:
        """Count anything else that must be visible."""
        self.counters[what] += n

    def anomaly(self, what: str, n: int = 1) -> None:
        """Count an event that is rare on a good line (``duplicates``, ``malformed``, ``late answers`` …)."""
        if n:
            self.counters[what] += n
            self.anomalies.add(what)

    def forgery(self, what: str) -> None:
        """Count data that only another sender than the device can have sent (``contradicting answers`` …)."""
        self.counters[what] += 1
        self.forgeries.add(what)

    @property
    def residue(self) -> int:
        """Samples not accounted for; anything but 0 is an alarm."""
        return self.expected - self.received - self.missed.total() - self.dropped.total() - self.owed

    def snapshot(self) -> dict[str, Any]:
        """Plain figures for health messages."""
        return {
            "expected": self.expected,
            "received": self.received,
            "missed": {reason: n for reason, n in self.missed.items() if n},
            "dropped": dict(self.dropped),
            **({"owed": self.owed} if self.owed else {}),
            "residue": self.residue,
            "counters": dict(self.counters),
            "anomalies": sorted(self.anomalies),
            "forgeries": sorted(self.forgeries),
        }


@dataclass(slots=True)
class Losses:
    """Samples that a device made, by its own numbering or time, and that never arrived.

    Those before the first sample of a connection count as ``outage``, others as ``gap``.
    """

    account: Account
    outage: str = "outage"
    resumed: bool = False
    """No sample has arrived since the connection was reopened."""

    def before_next(self, missing: int) -> None:
        """Count ``missing`` samples between the last received one and the next."""
        self.account.lose(missing, self.outage if self.resumed else "gap")
        self.resumed = False
