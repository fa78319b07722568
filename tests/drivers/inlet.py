"""An inlet that keeps what a driver gives, for tests."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable

import numpy as np

from cellwatt import Account, Identity, Reading, Stream
from tests.patience import PATIENCE


class CollectingInlet:
    """Keeps readings, events, brackets and resets in order; counts what is emitted as received."""

    def __init__(self) -> None:
        self.account = Account()
        self.identities: list[Identity] = []
        self.readings: list[Reading] = []
        self.brackets: list[tuple[int, int]] = []
        self.resets: list[str] = []
        self.events: list[tuple[str, str, dict[str, str | float]]] = []
        self._changed = asyncio.Event()
        self._last = 0

    def now(self) -> int:
        self._last = max(self._last, time.time_ns())
        return self._last

    def connected(self, identity: Identity) -> None:
        self.identities.append(identity)
        self._changed.set()

    def emit(self, reading: Reading) -> None:
        self.readings.append(reading)
        self.account.receive(len(reading.values))
        assert self.account.residue == 0, self.account.snapshot()
        self._changed.set()

    def bracket(self, stream: Stream, device_time: int, not_before: int) -> None:
        self.brackets.append((device_time, not_before))

    def clock_reset(self, stream: Stream, reason: str) -> None:
        self.resets.append(reason)

    def event(self, kind: str, text: str, **data: str | float) -> None:
        self.events.append((kind, text, data))
        self.account.count(kind)
        self._changed.set()

    def wake(self) -> None:
        """Let whoever waits look again."""
        self._changed.set()

    @property
    def values(self) -> np.ndarray:
        """All samples (n, channels)."""
        return np.concatenate([r.values for r in self.readings])

    @property
    def device_time(self) -> np.ndarray:
        """The device's time (n,) of all samples, ns."""
        return np.concatenate([r.device_time for r in self.readings if r.device_time is not None])

    def kinds(self) -> list[str]:
        """Kinds of the events in order."""
        return [kind for kind, _, _ in self.events]

    def of(self, stream: str) -> list[Reading]:
        """Readings of one stream."""
        return [r for r in self.readings if r.stream.name == stream]

    def stream(self, name: str) -> np.ndarray:
        """All samples (n, channels) of one stream."""
        return np.concatenate([r.values for r in self.of(name)])

    async def until(self, condition: Callable[[CollectingInlet], bool], timeout: float = PATIENCE) -> None:
        """Wait until the condition holds; fails with the account where it never does."""
        try:
            async with asyncio.timeout(timeout):
                while not condition(self):
                    self._changed.clear()
                    await self._changed.wait()
        except TimeoutError:
            raise AssertionError(f"never came: {self.account.snapshot()}, {self.events[-5:]}") from None


class PolledInlet(CollectingInlet):
    """Of a polled device, which has no clock; events are not counted in the account."""

    def event(self, kind: str, text: str, **data: str | float) -> None:
        self.events.append((kind, text, data))
        self._changed.set()

    def bracket(self, stream: Stream, device_time: int, not_before: int) -> None:
        raise AssertionError("a polled device has no clock")

    def clock_reset(self, stream: Stream, reason: str) -> None:
        raise AssertionError("a polled device has no clock")
