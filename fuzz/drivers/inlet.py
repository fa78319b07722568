"""An inlet that holds what a driver gives against its contract, and keeps nothing."""

from __future__ import annotations

import numpy as np

from cellwatt.account import Account
from cellwatt.batch import Reading
from cellwatt.channel import Stream
from cellwatt.driver import Identity

_STEP = 4_000_000  # ns by which the cell's time moves on between two looks


class CheckingInlet:
    """Every reading must fit its stream, and the account must explain every sample."""

    def __init__(self) -> None:
        self.account = Account()
        self._now = 1_795_255_163_290_084_047

    def now(self) -> int:
        """See ``Inlet.now``."""
        self._now += _STEP
        return self._now

    def connected(self, identity: Identity) -> None:
        """See ``Inlet.connected``."""

    def emit(self, reading: Reading) -> None:
        """See ``Inlet.emit``."""
        rows, columns = reading.values.shape
        assert rows > 0
        assert columns == len(reading.stream.channels)
        for array, kind in ((reading.device_time, np.int64), (reading.quality, np.uint8)):
            assert array is None or (array.shape == (rows,) and array.dtype == kind)
        self.account.receive(rows)
        assert self.account.residue == 0, self.account.snapshot()

    def bracket(self, stream: Stream, device_time: int, not_before: int) -> None:
        """See ``Inlet.bracket``."""
        np.int64(device_time)

    def clock_reset(self, stream: Stream, reason: str) -> None:
        """See ``Inlet.clock_reset``."""

    def event(self, kind: str, text: str, **_: str | float) -> None:
        """See ``Inlet.event``."""
        assert "\n" not in kind
        self.account.count(kind)
