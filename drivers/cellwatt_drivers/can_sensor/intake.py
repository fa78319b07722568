"""One message's frames on their way to samples."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from cellwatt.account import Losses
from cellwatt.batch import Reading
from cellwatt.channel import Quality, Stream
from cellwatt.driver import Inlet
from cellwatt_drivers.can_sensor.cycles import DUPLICATE, Cycle
from cellwatt_drivers.can_sensor.sensor_map import Decoding

if TYPE_CHECKING:
    from can import Message

_QUALITY = {"clipped": Quality.CLIPPED, "missing": Quality.MISSING, "told": Quality.GOOD}
_BACK = 0.5
"""s that time stamps may step back before the PC's clock counts as set."""
_BRACKET_EVERY = 1_000_000_000
"""ns between two comparisons of the PC's clock with the cell's."""


class Intake:
    """Decodes the frames of one stream, counts those that never came, and tells flags when they change."""

    def __init__(self, name: str, decoding: Decoding, period: float, inlet: Inlet) -> None:
        self.stream = Stream(decoding.name, decoding.channels, 1 / period if period else 0.0, "device")
        self.last = 0
        """Time stamp of the newest frame, ns; 0: none yet."""
        self._name = name
        self._decoding = decoding
        self._inlet = inlet
        self._cycle = Cycle(period, decoding.counts_to)
        self._losses = Losses(inlet.account, "disconnected")
        self._bracketed = 0
        self._flags: frozenset[str] = frozenset()
        self._times: list[int] = []
        self._rows: list[list[float]] = []
        self._qualities: list[int] = []

    @property
    def identifier(self) -> tuple[int, bool]:
        """The frame's identifier, and whether it is an extended one."""
        return self._decoding.message.frame_id, self._decoding.message.is_extended_frame

    def resume(self) -> None:
        """The bus was opened anew: what is missing now was lost while it was closed."""
        self._losses.resumed = True

    def take(self, frame: Message) -> None:
        """A frame of this message came."""
        try:
            signals = self._decoding.decode(bytes(frame.data))
        except ValueError as error:
            self._inlet.account.anomaly("malformed")
            if self._inlet.account.counters["malformed"] == 1:
                self._inlet.event("malformed_frame", f"{self._name}: {error}")
            return
        if not signals:  # a multiplexed message that carries others this time
            self._inlet.account.count("frames without the signals")
            return
        wanted = self._decoding.wanted
        if len(signals) < len(wanted.needed):
            self._inlet.account.count("signals beyond a short frame", len(wanted.needed) - len(signals))
        count = int(signals[wanted.counter]) if wanted.counter else 0
        lost = self._cycle.lost(frame.timestamp, count, self._losses.resumed)
        if lost == DUPLICATE:
            self._inlet.account.anomaly("duplicates")
            return
        self._losses.before_next(lost)
        self._add(frame.timestamp, signals)

    def _add(self, timestamp: float, signals: Mapping[str, float]) -> None:
        stamp = round(timestamp * 1e9)
        if stamp < self.last - _BACK * 1e9:
            self.flush(self._inlet.now())
            self._inlet.clock_reset(self.stream, f"the PC's clock was set back by {(self.last - stamp) / 1e9:.3f} s")
            self.last = 0
        self.last = max(stamp, self.last + 1)
        flags = frozenset(f for f in self._decoding.wanted.flags if signals[f])
        self._tell(flags)
        quality = max((_QUALITY[self._decoding.wanted.flags[f]] for f in flags), default=Quality.GOOD)
        wanted = zip(self._decoding.wanted.signals, self._decoding.factors, strict=True)
        row = [signals.get(s, math.nan) * f for s, f in wanted]
        self._times.append(self.last)
        self._rows.append([math.nan] * len(row) if quality is Quality.MISSING else row)
        self._qualities.append(quality)

    def _tell(self, flags: frozenset[str]) -> None:
        for flag in flags:
            self._inlet.account.count(f"flag {flag}")
        if flags != self._flags:
            text = f"raises {', '.join(sorted(flags))}" if flags else "raises no flag any more"
            self._inlet.event("sensor_flags", f"{self._name}: {self.stream.name} {text}")
            self._flags = flags

    def flush(self, arrival: int) -> None:
        """Hand over the samples since the last time, all read by the cell's time ``arrival``, ns."""
        if not self._rows:
            return
        self._bracket()
        self._inlet.account.expect(len(self._rows))
        self._inlet.emit(
            Reading(
                self.stream,
                np.array(self._rows),
                arrival,
                device_time=np.array(self._times, dtype=np.int64),
                quality=np.array(self._qualities, dtype=np.uint8),
            )
        )
        self._times, self._rows, self._qualities = [], [], []

    def _bracket(self) -> None:
        """Frames are stamped by this PC's own clock: what it says now is made no earlier than now."""
        not_before = self._inlet.now()
        if not_before - self._bracketed >= _BRACKET_EVERY:
            self._bracketed = not_before
            self._inlet.bracket(self.stream, time.time_ns(), not_before)
