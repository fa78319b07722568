"""Says when a model's inputs leave the range it was trained on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cellwatt.frames import FrameChannel
from cellwatt.results import Alarm

KIND = "model_outside_range"
STILL = 2e-3
"""rad, or whatever the unit: a narrower range is that of an input at rest, and its noise is no news."""


@dataclass(slots=True)
class _Excursion:
    """An alarm that is up; ``furthest`` value since, and ``inside`` frames in a row back in the range."""

    alarm: Alarm
    furthest: float
    inside: int = 0


@dataclass(frozen=True, slots=True)
class Limits:
    """One input: its channel and the range [``low``, ``high``] it had in training, in the channel's unit."""

    channel: FrameChannel
    low: float
    high: float

    @property
    def slack(self) -> float:
        """Distance by which each end of a narrow range is moved outwards, so that it is ``STILL`` wide."""
        return max(0.0, (STILL - (self.high - self.low)) / 2)

    def holds(self, value: float) -> bool:
        """True if a value is in the range; false where missing."""
        return self.low - self.slack <= value <= self.high + self.slack

    def beyond(self, value: float) -> float:
        """Distance of a value from the range; negative where it is inside."""
        return max(self.low - value, value - self.high)


class RangeWatch:
    """Raises an alarm for an input that is outside its range by more than ``margin`` of the range's width.

    A range narrower than ``STILL`` counts as that wide. An alarm is cleared after ``patience`` frames in a row within
    the range itself; frames without a value do not count. ``prefix`` starts the alarms' ids, ``model`` names the model
    in their text. Blocks may be cut anywhere.
    """

    def __init__(self, prefix: str, model: str, limits: Sequence[Limits], margin: float, patience: int) -> None:
        self._prefix = prefix
        self._model = model
        self._limits = limits
        self._patience = patience
        low, high = np.array([(x.low - x.slack, x.high + x.slack) for x in limits]).T
        self._floor, self._ceiling = low - margin * (high - low), high + margin * (high - low)
        self._up: dict[int, _Excursion] = {}

    def update(self, time: NDArray[np.int64], values: NDArray[np.float64]) -> list[Alarm]:
        """Alarms that change with the next n frames, in order; values (n, inputs), NaN where missing."""
        beyond = (values < self._floor) | (values > self._ceiling)
        if not self._up and not beyond.any():
            return []
        columns = sorted({*self._up, *np.flatnonzero(beyond.any(axis=0)).tolist()})
        changes = [a for c in columns for a in self._column(c, time, values[:, c], beyond[:, c])]
        return sorted(changes, key=lambda alarm: alarm.time)

    def _column(
        self, column: int, time: NDArray[np.int64], values: NDArray[np.float64], beyond: NDArray[np.bool_]
    ) -> list[Alarm]:
        changes = []
        limits = self._limits[column]
        for at, value, out in zip(time.tolist(), values.tolist(), beyond.tolist(), strict=True):
            excursion = self._up.get(column)
            if excursion is None:
                if out:
                    alarm = self._raised(limits, at, value)
                    self._up[column] = _Excursion(alarm, value)
                    changes.append(alarm)
            elif limits.holds(value):
                excursion.inside += 1
                if excursion.inside == self._patience:
                    changes.append(self._cleared(limits, at, self._up.pop(column)))
            elif value == value:  # a number
                excursion.inside = 0
                excursion.furthest = max(excursion.furthest, value, key=limits.beyond)
        return changes

    def _raised(self, limits: Limits, time: int, value: float) -> Alarm:
        channel, unit = limits.channel, limits.channel.unit
        return Alarm(
            id=f"{self._prefix}.{channel.name}.{KIND}",
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

    def _cleared(self, limits: Limits, time: int, excursion: _Excursion) -> Alarm:
        channel = limits.channel
        statement = f"{channel.name} is back in the range that model {self._model} was trained on."
        evidence = {**excursion.alarm.evidence, f"furthest_{channel.unit}": excursion.furthest}
        return replace(excursion.alarm, active=False, time=time, statement=statement, evidence=evidence)
