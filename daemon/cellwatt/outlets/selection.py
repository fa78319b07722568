"""The data that an outlet sends from a cell's frames: channels, rows per second, units and dead bands. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from cellwatt.channel import Quality
from cellwatt.frames import Frames, Layout
from cellwatt.quantity import Hertz
from cellwatt.section import Section
from cellwatt.units import Units

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Selection(Section):
    """Channels that an outlet sends, rows per second and units."""

    channels: Annotated[tuple[str, ...], Field(min_length=1)] = ("*",)
    """Channels of the frames, by name or pattern: ``arm.*.current``."""
    rate: Hertz = 1.0
    """Rows per second, at most the frames' rate. A row has means over its span; states and counters, last values."""
    units: Units = Units()
    """Units of the values sent; SI where no unit is set."""
    dead_band: Mapping[str, Annotated[float, Field(ge=0, allow_inf_nan=False)]] = {}
    """Smallest change that is sent, in the unit sent, by channel or pattern; the first pattern that matches applies."""


@dataclass(frozen=True, slots=True)
class Row:
    """Values of one span of the frames, in the units sent.

    ``time``, UTC ns, is the end of the span, a multiple of its length; ``sequence`` is that of its last frame.
    ``quality`` has the worst ``Quality`` of each channel: ``MISSING`` if ``values`` lacks the channel, and at least
    ``INTERPOLATED`` if it was missing during some of the span.
    """

    sequence: int
    time: int
    values: Mapping[str, float]
    quality: Mapping[str, int]

    @property
    def worst(self) -> int:
        """Worst quality of the values present; ``MISSING`` if there are none."""
        return max((q for name, q in self.quality.items() if name in self.values), default=int(Quality.MISSING))


class Picker:
    """Makes rows from frames; the same frames give the same rows, however they are split into blocks.

    A row is returned with the last frame of its span, or with the first frame after it. ``layout`` is that of the last
    frames; ``units``: unit of each channel in their rows; ``unmatched``: patterns that match none of their channels;
    ``span``: time between two of their rows, ns.
    """

    def __init__(self, selection: Selection, layout: Layout | None = None) -> None:
        self._selection = selection
        self._begun: _Span | None = None
        self._lay_out(Layout((), selection.rate) if layout is None else layout)

    def _lay_out(self, layout: Layout) -> None:
        self.layout, selection = layout, self._selection
        self.span = max(layout.step, round(1e9 / selection.rate))
        chosen = [i for i, name in enumerate(layout.names) if fits(name, selection.channels)]
        self.unmatched = tuple(p for p in selection.channels if not any(fnmatchcase(n, p) for n in layout.names))
        shown = [selection.units.of(layout.channels[i].unit) for i in chosen]
        self._names = tuple(layout.names[i] for i in chosen)
        self.units: Mapping[str, str] = {n: unit.name for n, unit in zip(self._names, shown, strict=True)}
        self._columns = np.array(chosen, np.intp)
        self._mean = np.array([layout.channels[i].kind == "continuous" for i in chosen], bool)
        self._factor = np.array([unit.factor for unit in shown])
        self._zero = np.array([unit.zero for unit in shown])
        self._band = np.array([_band(name, selection.dead_band) for name in self._names])
        self._banded = bool(self._band.any())
        self._all = np.ones(len(chosen), bool)
        self._sent = np.full(len(chosen), np.nan)
        self._known = np.zeros(len(chosen), bool)
        """Channels that were sent at least once."""

    def rows(self, frames: Frames) -> Iterator[Row]:
        """Rows that these frames complete; a span in which no channel changed has none. Exhaust the iterator."""
        if frames.layout != self.layout:
            yield from self.rest()
            self._lay_out(frames.layout)
        if not len(frames) or not len(self._columns):
            return
        number = -(-frames.time // self.span)
        if self._begun is None and self.span == self.layout.step and (np.diff(number) > 0).all():
            yield from self._each(frames, number)
            return
        edges = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(frames)]
        for first, end in pairwise(edges):
            span = self._begun
            if span is None or span.number != number[first]:
                yield from self.rest()
                span = self._begun = _Span(int(number[first]), len(self._columns))
            span.add(frames.values[first:end, self._columns], frames.quality[first:end, self._columns])
            span.sequence = frames.sequence + end - 1
            if frames.time[end - 1] + self.layout.step > span.number * self.span:
                yield from self.rest()

    def rest(self) -> Iterator[Row]:
        """The unfinished row, if there is one: for the end of a recording or a layout."""
        span, self._begun = self._begun, None
        if span is not None:
            values = self._shown(np.where(self._mean, span.mean, span.last))
            yield from self._row(span.sequence, span.number, values, span.quality)

    def _each(self, frames: Frames, number: NDArray[np.int64]) -> Iterator[Row]:
        """Rows of one frame each, equal to those of ``_Span``, without its sums."""
        values, quality = frames.values[:, self._columns], frames.quality[:, self._columns]
        there = np.isfinite(values)
        sums = np.where(self._mean, 0.0 + values, values)
        shown = self._shown(np.where(there, sums, np.nan))
        quality = np.where(there, quality, np.uint8(Quality.MISSING))
        for n, of in enumerate(number.tolist()):
            yield from self._row(frames.sequence + n, of, shown[n], quality[n])

    def _shown(self, values: Floats) -> Floats:
        """Values (…, channels) in the units sent."""
        scaled = values / self._factor
        found: Floats = np.where(self._zero != 0.0, scaled + self._zero, scaled)
        return found

    def _row(self, sequence: int, number: int, values: Floats, quality: NDArray[np.uint8]) -> Iterator[Row]:
        sent = self._news(values) if self._banded else self._all
        if not sent.any():
            return
        if self._banded:
            self._sent[sent], self._known[sent] = values[sent], True
        numbers: Mapping[str, float] = self._named(values, sent & np.isfinite(values))
        qualities: Mapping[str, int] = self._named(quality, sent)
        yield Row(sequence, number * self.span, numbers, qualities)

    def _news(self, values: Floats) -> Flags:
        """Channels to send: without a dead band, new, changed by at least the band, or newly missing or present."""
        turned = np.isfinite(values) != np.isfinite(self._sent)
        with np.errstate(invalid="ignore"):
            moved = np.abs(values - self._sent) >= self._band
        found: Flags = (self._band == 0.0) | ~self._known | turned | moved
        return found

    def _named(self, row: NDArray[np.generic], wanted: Flags) -> dict[str, Any]:
        values = row.tolist()
        if wanted.all():
            return dict(zip(self._names, values, strict=True))
        return {self._names[i]: values[i] for i in np.flatnonzero(wanted).tolist()}


class _Span:
    """Sums over the frames of one span, added one by one, so that the split into blocks does not matter."""

    def __init__(self, number: int, channels: int) -> None:
        self.number = number
        self.sequence = 0
        self.last: Floats = np.full(channels, np.nan)
        self._total = np.zeros((1, channels))
        self._count = np.zeros(channels, np.int64)
        self._frames = 0
        self._worst = np.zeros(channels, np.uint8)

    def add(self, values: Floats, quality: NDArray[np.uint8]) -> None:
        """Add frames (n, channels)."""
        there = np.isfinite(values)
        known = np.where(there, values, 0.0)
        self._total = np.add.accumulate(np.concatenate([self._total, known]))[-1:]
        self._count += there.sum(axis=0)
        self._frames += len(values)
        self._worst = np.maximum(self._worst, np.where(there, quality, 0).max(axis=0))
        newest = np.where(there, np.arange(len(values))[:, None], -1).max(axis=0)
        self.last = np.where(newest >= 0, values[newest, np.arange(values.shape[1])], self.last)

    @property
    def mean(self) -> Floats:
        """Means (channels,), NaN for a channel without a value."""
        with np.errstate(invalid="ignore"):
            found: Floats = self._total[0] / np.where(self._count, self._count, np.nan)
        return found

    @property
    def quality(self) -> NDArray[np.uint8]:
        """Worst quality (channels,)."""
        partly = np.where(self._count < self._frames, np.uint8(Quality.INTERPOLATED), np.uint8(Quality.GOOD))
        found = np.maximum(self._worst, partly)
        return np.where(self._count, found, np.uint8(Quality.MISSING))


def fits(name: str, patterns: Iterable[str]) -> bool:
    """True if a name matches one of the patterns."""
    return any(fnmatchcase(name, pattern) for pattern in patterns)


def _band(name: str, bands: Mapping[str, float]) -> float:
    return next((band for pattern, band in bands.items() if fnmatchcase(name, pattern)), 0.0)
