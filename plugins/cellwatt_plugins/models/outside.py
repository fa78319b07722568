"""Alarms about inputs of a model that leave the range it was trained on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt.alarms import AlarmBook, Patience
from cellwatt.arrays import Float, Nanoseconds
from cellwatt.frames import FrameChannel
from cellwatt.results import Alarm

KIND = "model_outside_range"
STILL = 2e-3
"""Width of a range in rad, or the input's unit, below which the input was at rest and shows only noise …"""
STILL_RATE = 2e-2
"""… and in rad/s for a velocity, which is noisier than the position that it is derived from."""


OUTSIDE = 0.05
"""Default share of its training range by which an input may leave the range without an alarm."""


@dataclass(frozen=True)
class Limits:
    """Ranges of a model's inputs in training, (inputs,) each; ranges narrower than noise at rest are widened to it."""

    low: Float
    high: Float
    floor: Float
    ceiling: Float
    """Values beyond which an input has left its range."""

    @classmethod
    def of(cls, ranges: Float, units: Sequence[str], margin: float) -> Limits:
        """From ``ranges`` (inputs, 2); an input may leave its range by ``margin``, a share of the width."""
        still = np.array([STILL_RATE if unit == "rad/s" else STILL for unit in units])
        slack = np.maximum(0.0, (still - np.ptp(ranges, axis=1)) / 2)
        low, high = ranges[:, 0] - slack, ranges[:, 1] + slack
        beyond = margin * (high - low)
        return cls(low, high, low - beyond, high + beyond)

    def left_by(self, values: Float) -> NDArray[np.bool_]:
        """(n, inputs) true where values (n, inputs) have left their range; NaN has not."""
        return np.asarray((values < self.floor) | (values > self.ceiling))


class RangeWatch:
    """Raises an alarm for an input that is outside its range by more than ``margin`` of the range's width.

    ``channels`` are the inputs, ``ranges`` (inputs, 2) their ranges in training, in their units. An alarm is cleared
    after ``patience`` consecutive frames within the range itself; frames without a value do not count. ``prefix``
    starts the alarms' ids, ``model`` names the model in their text. Frames may be split into blocks anywhere.
    """

    def __init__(
        self, prefix: str, model: str, channels: Sequence[FrameChannel], ranges: Float, margin: float, patience: int
    ) -> None:
        self._prefix, self._model, self._channels, self._ranges = prefix, model, channels, ranges
        self._patience = Patience(patience)
        self._limits = Limits.of(ranges, [channel.unit for channel in channels], margin)
        self._book = AlarmBook()
        self._furthest: dict[int, float] = {}
        """Value furthest outside the range, by the column of each active alarm."""

    def update(self, time: Nanoseconds, values: Float) -> list[Alarm]:
        """Alarms that change with the next n frames, in order; values (n, inputs), NaN where missing."""
        beyond = self._limits.left_by(values)
        if not self._furthest and not beyond.any():
            return []
        columns = sorted({*self._furthest, *np.flatnonzero(beyond.any(axis=0)).tolist()})
        changes = [a for c in columns for a in self._column(c, time, values[:, c], beyond[:, c])]
        return sorted(changes, key=lambda alarm: alarm.time)

    def _column(self, column: int, time: Nanoseconds, values: Float, beyond: NDArray[np.bool_]) -> list[Alarm]:
        changes: list[Alarm] = []
        channel, (low, high) = self._channels[column], self._ranges[column].tolist()
        name = f"{self._prefix}.{channel.name}.{KIND}"
        for at, value, out in zip(time.tolist(), values.tolist(), beyond.tolist(), strict=True):
            if name not in self._book:
                if out:
                    changes += self._book.raise_(self._alarm(name, channel, (low, high), at, value))
                    self._furthest[column] = value
            elif self._limits.low[column] <= value <= self._limits.high[column]:
                statement = f"Resolved: {channel.name} is back in the range that model {self._model} was trained on"
                evidence = {**self._book[name].alarm.evidence, f"furthest_{channel.unit}": self._furthest[column]}
                if over := self._book.clear(name, at, statement, after=self._patience, evidence=evidence):
                    del self._furthest[column]
                changes += over
            elif value == value:  # a number
                self._book.raise_(self._book[name].alarm, update=False)
                self._furthest[column] = max(self._furthest[column], value, key=lambda v: max(low - v, v - high))
        return changes

    def _alarm(self, name: str, channel: FrameChannel, trained: tuple[float, float], time: int, value: float) -> Alarm:
        (low, high), unit = trained, channel.unit
        return Alarm(
            id=name,
            kind=KIND,
            severity="info",
            active=True,
            since=time,
            time=time,
            statement=f"{channel.name} is {value:.6g} {unit}, outside the {low:.6g} to {high:.6g} {unit} "
            f"that model {self._model} was trained on: its predictions are extrapolated.",
            source=channel.source,
            evidence={
                "model": self._model,
                "channel": channel.name,
                f"value_{unit}": value,
                f"low_{unit}": low,
                f"high_{unit}": high,
            },
        )
