"""A cell of the plant in figures, and the energy that its tasks took today."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import datetime
from typing import Any, Final

from cellwatt.live.site import summary
from cellwatt.outlets.page import shapes
from cellwatt.outlets.zenoh.received import Health

_WEB: Final = ("http://", "https://")

Body = Mapping[str, Any]


def plant_cell(
    site: str,
    cell: str,
    status: Body,
    *,
    age_s: float | None = None,
    gone: bool = False,
    energy_J: float | None = None,  # noqa: N803 (the unit)
    task: str | None = None,
) -> dict[str, Any]:
    """A cell in figures, JSON-ready; ``status`` is its health, empty if it does not answer us."""
    told = summary(cell, Health(0, 0, {}, status) if status else None)
    known = {alarm["id"] for alarm in status.get("alarms", ()) if alarm.get("acknowledged")}
    return {
        "site": site,
        **told,
        "state": "gone" if gone else told["state"],
        "time": shapes.ms(told["time"]),
        "age_s": age_s,
        "alarms": [
            {**alarm, "since": shapes.ms(alarm["since"]), "acknowledged": alarm["id"] in known}
            for alarm in told["alarms"]
        ],
        "shelved": len(status.get("shelved", ())),
        "power_W": _number(status.get("power_W"), None),
        "energy_today_J": _number(status.get("energy_today_J"), energy_J),
        "task": task,
        "page": page_of(status),
    }


def _number(told: object, otherwise: float | None) -> float | None:
    return told if isinstance(told, int | float) else otherwise


def page_of(status: Body) -> str | None:
    """Address of the cell's own page, if its health tells one that a browser may open."""
    outlets = status.get("sinks")
    page = outlets.get("page") if isinstance(outlets, Mapping) else None
    url = page.get("url") if isinstance(page, Mapping) else None
    return url if isinstance(url, str) and url.startswith(_WEB) else None


class EnergyToday:
    """Energy of one cell's tasks that ended since midnight here, J, each counted once."""

    def __init__(self) -> None:
        self._day: tuple[int, int, int] = (0, 0, 0)
        self._seen: set[tuple[int, int]] = set()
        self._sum = 0.0
        self.task: str | None = None
        """The task that ended last."""
        self._last = 0

    def add(self, session: int, sequence: int, end: int, total: float, task: str) -> None:
        """Take an energy message, number ``sequence`` of ``session``, of a task that ended at ``end`` ns."""
        if end >= self._last:
            self._last, self.task = end, task
        day = _day(end * 1e-9)
        if day < self._day or (session, sequence) in self._seen or not math.isfinite(total):
            return
        if day > self._day:
            self._day, self._sum = day, 0.0
            self._seen.clear()
        self._seen.add((session, sequence))
        self._sum += total

    def total(self, now: float) -> float | None:
        """Energy since midnight at UTC time ``now``, s; ``None`` where no task ended today."""
        return self._sum if self._seen and self._day == _day(now) else None


def _day(time: float) -> tuple[int, int, int]:
    here = datetime.fromtimestamp(time).astimezone()
    return here.year, here.month, here.day
