"""Blocks of samples on their way from a driver to the record and the frames."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float, Nanoseconds, Qualities
from cellwatt.channel import Stream


@dataclass(frozen=True, slots=True)
class Reading:
    """n samples of one stream as a driver emits them, before they are stamped with the cell's time.

    Times are ns. ``arrival`` is the cell's time when the block was read. Sources with a clock set
    ``device_time`` (n,), in the time base of the device; polled ones set ``asked``, the cell's time when the
    request was sent. ``values`` is (n, channels) in SI units, NaN where the device sent no value;
    ``quality`` (n,), all good if omitted.
    """

    stream: Stream
    values: Float
    arrival: int
    device_time: Nanoseconds | None = None
    asked: int | None = None
    quality: Qualities | None = None


@dataclass(frozen=True, slots=True)
class Batch:
    """n stamped samples of one stream.

    ``time`` (n,) is the cell's time, UTC ns, strictly rising within a stream; ``bound`` (n,) the half
    width in ns within which the true time lies. ``sequence`` numbers the first sample within
    (session, source, stream) and never skips: a hole in it is a hole in transport, not in the cell.
    ``arrival`` as in ``Reading``; ``device_time`` (n,) or ``None``.
    """

    source: str
    stream: Stream
    sequence: int
    arrival: int
    time: Nanoseconds
    bound: Nanoseconds
    values: Float
    quality: Qualities
    device_time: Nanoseconds | None = field(default=None)
    rows: NDArray[np.void] | None = field(default=None, init=False, repr=False, compare=False)
    """The same samples as rows of the record, if the batch was read from a ring; a changed copy has none."""

    def __len__(self) -> int:
        return len(self.time)


@dataclass(frozen=True, slots=True)
class Tick:
    """The cell's time reached ``time`` ns while no source delivered; recorded so that replay is exact."""

    time: int
