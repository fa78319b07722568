"""Samples with device time stamps, collected and handed over together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from cellwatt.batch import Reading
from cellwatt.channel import Quality, Stream
from cellwatt.driver import Inlet


class Row(NamedTuple):
    """One sample: the device's time, ns, and the values (channels,)."""

    time: int
    values: Sequence[float]
    quality: Quality = Quality.GOOD


class Rows(list[Row]):
    """Samples of a stream that are not handed over yet, in order."""

    def hand_over(self, inlet: Inlet, stream: Stream, arrival: int) -> None:
        """Count and emit all samples; the newest one arrived at the cell's time ``arrival``, ns."""
        if not self:
            return
        times, values, quality = zip(*self, strict=True)
        self.clear()
        inlet.account.expect(len(times))
        stamps, marks = np.array(times, dtype=np.int64), np.array(quality, dtype=np.uint8)
        inlet.emit(Reading(stream, np.array(values), arrival, stamps, quality=marks))
