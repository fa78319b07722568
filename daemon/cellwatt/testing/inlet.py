"""An inlet that collects a driver's output."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray

from cellwatt.account import Account
from cellwatt.batch import Reading
from cellwatt.channel import Stream
from cellwatt.driver import Identity

_LOOK = 0.02
"""Interval at which a condition is checked while nothing arrives, s."""


class CollectingInlet:
    """Stores readings, events, brackets and resets in order; counts emitted samples as received.

    ``residues`` are the account's residues one turn of the loop after each reading, all 0 if the driver counts
    correctly. ``early`` counts readings before ``connected``; ``begin`` starts a new run. ``epochs`` numbers the time
    base of each reading's stream: 0, plus 1 for each ``clock_reset``.
    """

    def __init__(self) -> None:
        self.account = Account()
        self.identities: list[Identity] = []
        self.readings: list[Reading] = []
        self.epochs: list[int] = []
        self.brackets: list[tuple[int, int]] = []
        self.resets: list[tuple[str, str]] = []
        self.events: list[tuple[str, str]] = []
        self.residues: list[int] = []
        self.early = 0
        self._connected = False
        self._changed = asyncio.Event()
        self._last = 0

    def begin(self) -> None:
        """Prepare for a (new) run of the driver."""
        self._connected = False

    def now(self) -> int:
        """See ``Inlet.now``."""
        self._last = max(self._last, time.time_ns())
        return self._last

    def connected(self, identity: Identity) -> None:
        """See ``Inlet.connected``."""
        self.identities.append(identity)
        self._connected = True
        self._changed.set()

    def emit(self, reading: Reading) -> None:
        """See ``Inlet.emit``."""
        self.early += not self._connected
        self.readings.append(reading)
        self.epochs.append(sum(name == reading.stream.name for name, _ in self.resets))
        self.account.receive(len(reading.values))
        asyncio.get_running_loop().call_soon(lambda: self.residues.append(self.account.residue))
        self._changed.set()

    def bracket(self, stream: Stream, device_time: int, not_before: int) -> None:
        """See ``Inlet.bracket``."""
        self.brackets.append((device_time, not_before))

    def clock_reset(self, stream: Stream, reason: str) -> None:
        """See ``Inlet.clock_reset``."""
        self.resets.append((stream.name, reason))

    def event(self, kind: str, text: str, **_: str | float) -> None:
        """See ``Inlet.event``."""
        self.events.append((kind, text))
        self.account.count(f"event {kind}")
        self._changed.set()

    @property
    def samples(self) -> int:
        """Number of samples received."""
        return self.account.received

    def of(self, stream: str) -> list[Reading]:
        """Readings of one stream."""
        return [r for r in self.readings if r.stream.name == stream]

    def channel(self, name: str) -> NDArray[np.float64]:
        """All values (n,) of one channel in order."""
        found = [r.values[:, r.stream.names.index(name)] for r in self.readings if name in r.stream.names]
        return np.concatenate(found) if found else np.empty(0)

    async def until(self, condition: Callable[[], object], seconds: float = 20.0) -> None:
        """Wait until a condition holds; it is checked after each reading and event, and at intervals.

        Raises ``TimeoutError`` after ``seconds``.
        """
        async with asyncio.timeout(seconds):
            while not condition():
                self._changed.clear()
                with suppress(TimeoutError):
                    async with asyncio.timeout(_LOOK):
                        await self._changed.wait()
