"""Alarms about inputs of a model that leave the range it was trained on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt.alarms import AlarmBook, Patience
from cellwatt.frames import FrameChannel
from cellwatt.results import Alarm

KIND = "model_outside_range"
STILL = 2e-3
"""rad, or whatever the unit: a narrower range is that of an input at rest, and its noise is no news …"""
STILL_RATE = 2e-2
"""… rad/s, for a velocity, which is noisier than the position that it is made of."""


@dataclass(frozen=True, slots=True)
class Limits:
    """One input: its channel and the range [``low``, ``high``] it had in training, in the channel's unit."""

    channel: FrameChannel
    low: float
    high: float

    @property
    def slack(self) -> float:
        """Distance by which each end of a narrow range is moved outwards, so that it is that of an input at rest."""
        still = STILL_RATE if self.channel.unit == "rad/s" else STILL
        return max(0.0, (still - (self.high - self.low)) / 2)

    def holds(self, value: float) -> bool:
        """True if a value is in the range; false where missing."""
        return self.low - self.slack <= value <= self.high + self.slack

    def beyond(self, value: float) -> float:
        """Distance of a value from the range; negative where it is inside."""
        return max(self.low - value, value - self.high)


class RangeWatch:
    """Raises an alarm for an input that is outside its range by more than ``margin`` of the range's width.

    A range narrower than that of an input at rest counts as that wide. An alarm is cleared after ``patience`` frames in
    a row within the range itself; frames without a value do not count. ``prefix`` starts the alarms' ids, ``model``
    names the model in their text. Blocks may be cut anywhere.
    """

    def __init__(self, prefix: str, model: str, limits: Sequence[Limits], margin: float, patience: int) -> None:
        self._prefix = prefix
        self._model = model
        self._limits = limits
        self._patience = Patience(patience)
        low, high = np.array([(x.low - x.slack, x.high + x.slack) for x in limits]).T
        self._floor, self._ceiling = low - margin * (high - low), high + margin * (high - low)
        self._book = AlarmBook()
        self._furthest: dict[int, float] = {}
        """Value that is furthest outside, by the columns whose alarm is up."""

    def update(self, time: NDArray[np.int64], values: NDArray[np.float64]) -> list[Alarm]:
        """Alarms that change with the next n frames, in order; values (n, inputs), NaN where missing."""
        beyond = (values < self._floor) | (values > self._ceiling)
        if not self._furthest and not beyond.any():
            return []
        columns = sorted({*self._furthest, *np.flatnonzero(beyond.any(axis=0)).tolist()})
        changes = [a for c in columns for a in self._column(c, time, values[:, c], beyond[:, c])]
        return sorted(changes, key=lambda alarm: alarm.time)

    def _column(
        self, column: int, time: NDArray[np.int64], values: NDArray[np.float64], beyond: NDArray[np.bool_]
    ) -> list[Alarm]:
        changes: list[Alarm] = []
        limits = self._limits[column]
        name = f"{self._prefix}.{limits.channel.name}.{KIND}"
        for at, value, out in zip(time.tolist(), values.tolist(), beyond.tolist(), strict=True):
            if name not in self._book:
                if out:
                    changes += self._book.raise_(self._alarm(name, limits, at, value))
                    self._furthest[column] = value
            elif limits.holds(value):
                said = f"Resolved: {limits.channel.name} is back in the range that model {self._model} was trained on"
                furthest = {f"furthest_{limits.channel.unit}": self._furthest[column]}
                evidence = {**self._book[name].alarm.evidence, **furthest}
                if over := self._book.clear(name, at, said, after=self._patience, evidence=evidence):
                    del self._furthest[column]
                changes += over
            elif value == value:  # a number
                self._book.raise_(self._book[name].alarm, update=False)
                self._furthest[column] = max(self._furthest[column], value, key=limits.beyond)
        return changes

    def _alarm(self, name: str, limits: Limits, time: int, value: float) -> Alarm:
        channel, unit = limits.channel, limits.channel.unit
        return Alarm(
            id=name,
            kind=KIND,
            severity="info",
            active=True,
            since=time,
            time=time,
            statement=f"{channel.name} is {value:.6g} {unit}, outside the {limits.low:.6g} to {limits.high:.6g} {unit} "
            f"that model {self._model} was trained on: its predictions are extrapolated.",
            source=channel.source,
            evidence={
                "model": self._model,
                "channel": channel.name,
                f"value_{unit}": value,
                f"low_{unit}": limits.low,
                f"high_{unit}": limits.high,
            },
        )
