"""Present power of a cell, and its energy since midnight, from the frames; for health."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
from collections import deque
from datetime import date, datetime
from pathlib import Path
from typing import Any, Final

import numpy as np
from pydantic import BaseModel

from cellwatt.files import read_saved, replace_text
from cellwatt.frames import Frames, Layout
from cellwatt.results import Energy

FILE: Final = "energy.json"
MEASURED: Final = ("supply.power", "bus.power")
"""Channels with the power of an arm, by preference; the first that any source has is summed over all sources."""
PERIOD: Final = 10.0
"""Period in s at which today's energy is written."""
SPAN: Final = 10**9
"""Time in ns over which the present power is averaged."""


class _Saved(BaseModel):
    day: date
    joule: float
    time: int


class Consumption:
    """Power and energy of a cell; a missing value counts as 0 W, so the energy is a lower limit.

    The power is unknown if no value was measured in the last second. Without a power channel, the energies of the tasks
    are summed.
    """

    def __init__(self) -> None:
        self._layout: Layout | None = None
        self._columns: list[int] = []
        self._recent: deque[tuple[int, float]] = deque()
        """Time, ns, and power, W, of the frames of the last second; NaN where no power was measured."""
        self._day: date | None = None
        self._joule = 0.0
        self._time = self._written = 0
        self.task: str | None = None
        """Name of the task that ended last."""

    def end(self, energy: Energy) -> None:
        """Add the energy of a task that has ended."""
        self.task = energy.task
        if not self._columns and math.isfinite(energy.total):
            self._date(energy.end)
            self._joule += energy.total

    def add(self, frames: Frames) -> None:
        """Add frames, in order; frames that were added before are ignored."""
        if frames.layout is not self._layout:
            self._layout, self._columns = frames.layout, _columns(frames.layout)
            self._recent.clear()
        if not self._columns:
            if len(frames) and self._day is not None:
                self._date(int(frames.time[-1]))
            return
        new = int(np.searchsorted(frames.time, self._time, side="right"))
        values = frames.values[new:, self._columns]
        power = np.nansum(values, axis=1)
        power[np.isnan(values).all(axis=1)] = np.nan
        step = frames.layout.step * 1e-9
        for time, watts in zip(frames.time[new:].tolist(), power.tolist(), strict=True):
            self._date(time)
            self._joule += 0.0 if math.isnan(watts) else watts * step
            self._recent.append((time, watts))
        while self._recent and self._recent[0][0] <= self._time - SPAN:
            self._recent.popleft()

    def _date(self, time: int) -> None:
        """Reset the energy at midnight, checked each quarter of an hour: time zones differ by whole quarters."""
        if self._day is None or time // _QUARTER != self._time // _QUARTER:
            day = datetime.fromtimestamp(time * 1e-9).astimezone().date()
            if day != self._day:
                self._day, self._joule = day, 0.0
        self._time = time

    def status(self) -> dict[str, Any]:
        """Present ``power_W`` and ``energy_today_J``, ``None`` if not measured."""
        watts = [watts for _, watts in self._recent if not math.isnan(watts)]
        return {
            "power_W": round(sum(watts) / len(self._recent), 1) if watts else None,
            "energy_today_J": round(self._joule, 1) if self._day is not None else None,
        }

    # over a restart -------------------------------------------------------------------------------

    def read(self, folder: Path, now: int) -> None:
        """Continue with today's energy as an earlier process wrote it; ``now`` is the cell's time, ns."""
        saved = read_saved(folder / FILE, _Saved.model_validate_json, "today's energy starts from 0")
        if saved is not None:
            self._day, self._joule = saved.day, saved.joule
            self._time = saved.time if saved.time <= now else 0  # the PC's clock has been set back since

    async def keep(self, folder: Path) -> None:
        """Write today's energy periodically, for ``read``."""
        while True:
            await asyncio.sleep(PERIOD)
            await self.write(folder)

    async def write(self, folder: Path) -> None:
        """Write today's energy if it has changed since the last write."""
        if self._day is not None and (time := self._time) != self._written:
            text = json.dumps({"day": self._day.isoformat(), "joule": self._joule, "time": time})
            with contextlib.suppress(OSError):  # the recorder reports disk errors
                await asyncio.to_thread(replace_text, folder / FILE, text)
                self._written = time


_QUARTER: Final = 900 * 10**9  # ns


def _columns(layout: Layout) -> list[int]:
    for name in MEASURED:
        found = [i for i, channel in enumerate(layout.channels) if channel.short == name and channel.unit == "W"]
        if found:
            return found
    return []
