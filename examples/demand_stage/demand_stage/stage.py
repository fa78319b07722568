"""Frames in, demand and its alarm out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import Field

from cellwatt import (
    Alarm,
    AlarmBook,
    CellInfo,
    Frames,
    Layout,
    Prediction,
    Result,
    Stage,
    StageSettings,
)
from cellwatt.quantity import Fraction, Seconds, Watts
from demand_stage.mean import MovingMean


class DemandSettings(StageSettings):
    """Mean power over the utility's interval, and when it is too high."""

    limit: Watts = Field(gt=0)
    """Mean power above which the alarm is raised."""
    window: Seconds = Field(900.0, gt=0)
    """Time over which the mean is taken."""
    power: str = "supply.power"
    """Channel, in W; with its source (mains.supply.power) where several sources give it."""
    release: Fraction = Field(0.05, ge=0, lt=1)
    """Distance below the limit, as a share of it, to which the mean must fall before the alarm is cleared."""


class DemandStage(Stage[DemandSettings]):
    """Gives the mean as a prediction named like the stage, and the alarm ``demand_high``."""

    Settings = DemandSettings
    title = "mean power over the utility's interval, with an alarm above a limit"

    def __init__(self, name: str, settings: DemandSettings, layout: Layout, cell: CellInfo) -> None:
        super().__init__(name, settings, layout, cell)
        self._column = layout.index(settings.power, "W")
        self._mean = MovingMean(max(1, round(settings.window * layout.rate)))
        self._book = AlarmBook()

    def process(self, frames: Frames, upstream: Sequence[Result]) -> Sequence[Result]:
        """The mean at each frame of the block, and the alarm where it changed."""
        mean = self._mean.update(frames.values[:, self._column])
        if not np.isfinite(mean).any():
            return ()
        demand = Prediction(
            self.name, frames.sequence, tuple(frames.time.tolist()), {"demand": tuple(mean.tolist())}, {"demand": "W"}
        )
        return [demand, *self._alarms(frames, mean)]

    def _alarms(self, frames: Frames, mean: np.ndarray) -> list[Alarm]:
        limit, release = self.settings.limit, self.settings.limit * (1 - self.settings.release)
        found: list[Alarm] = []
        for time, value in zip(frames.time.tolist(), mean.tolist(), strict=True):
            if value > limit:
                found += self._book.raise_(self._alarm(time, value), update=False)
            elif value < release:
                text = f"Resolved: {value:.0f} W on average, below the limit of {limit:.0f} W"
                found += self._book.clear(f"{self.name}-demand", time, text, evidence=self._evidence(value))
        return found

    def _alarm(self, time: int, value: float) -> Alarm:
        s = self.settings
        return Alarm(
            id=f"{self.name}-demand",
            kind="demand_high",
            severity="warning",
            active=True,
            since=time,
            time=time,
            statement=f"{value:.0f} W on average over {s.window / 60:g} min; the limit is {s.limit:.0f} W",
            source=self.layout.channels[self._column].source,
            evidence=self._evidence(value),
        )

    def _evidence(self, value: float) -> dict[str, float]:
        return {"mean_w": value, "limit_w": self.settings.limit, "window_s": self.settings.window}
