"""An inlet that keeps what a driver gives, for tests."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from cellwatt import Reading, Stream
from cellwatt.testing import CollectingInlet as KitsInlet
from tests.patience import PATIENCE


class CollectingInlet(KitsInlet):
    """The kit's, which also needs no loop; the account is even at each reading, and events keep their data."""

    def emit(self, reading: Reading) -> None:
        self.readings.append(reading)
        self.epochs.append(len(self.resets))
        self.account.receive(len(reading.values))
        assert self.account.residue == 0, self.account.snapshot()
        self._changed.set()

    def clock_reset(self, stream: Stream, reason: str) -> None:
        self.resets.append(reason)

    def event(self, kind: str, text: str, **data: str | float) -> None:
        self.events.append((kind, text, data))
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

    def texts(self, kind: str = "") -> list[str]:
        """Texts of the events in order, or of those of one kind."""
        return [text for its, text, _ in self.events if kind in ("", its)]

    def stream(self, name: str) -> np.ndarray:
        """All samples (n, channels) of one stream."""
        return np.concatenate([r.values for r in self.of(name)])

    async def until(self, condition: Callable[[CollectingInlet], object], seconds: float = PATIENCE) -> None:
        """Wait until the condition holds; fails with the account where it never does."""
        try:
            await super().until(lambda: condition(self), seconds)
        except TimeoutError:
            raise AssertionError(f"never came: {self.account.snapshot()}, {self.events[-5:]}") from None


class PolledInlet(CollectingInlet):
    """Of a polled device, which has no clock."""

    def bracket(self, stream: Stream, device_time: int, not_before: int) -> None:
        raise AssertionError("a polled device has no clock")

    def clock_reset(self, stream: Stream, reason: str) -> None:
        raise AssertionError("a polled device has no clock")
