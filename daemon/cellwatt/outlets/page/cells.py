"""The cells that a page shows, each with its feed, its recordings and the means to act on it."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal
from urllib.parse import quote

from cellwatt.errors import CellwattError
from cellwatt.live.site import summary
from cellwatt.outlets.page import shapes
from cellwatt.outlets.page.archive import Archive
from cellwatt.outlets.page.feed import Feed
from cellwatt.outlets.page.streams import Hub

Mode = Literal["cell", "plant", "recordings"]

Order = Callable[[Mapping[str, Any]], Awaitable[None]]
"""Sends an order to the cell's daemon; raises ``CellwattError`` with the daemon's reason."""


@dataclass(slots=True)
class Cell:
    """One cell; ``order`` is ``None`` if the page is read-only."""

    feed: Feed
    archive: Archive
    order: Order | None = None


def prefix(site: str, cell: str) -> str:
    """Path of the API of a cell."""
    return f"/api/cells/{quote(site, safe='')}/{quote(cell, safe='')}"


class OneCell:
    """A page of one cell, or of no cell, for dropped recordings only. ``acts``: True unless the page is read-only."""

    hub: Hub | None = None
    """Streams changes of ``summary``; only on a page of many cells."""

    def __init__(self, cell: Cell | None) -> None:
        self._cell = cell
        self.mode: Mode = "recordings" if cell is None else "cell"
        self.site: str | None = None if cell is None else cell.feed.site
        self.acts = cell is not None and cell.order is not None

    @property
    def names(self) -> Sequence[tuple[str, str]]:
        """Site and name of each cell."""
        return () if self._cell is None else ((self._cell.feed.site, self._cell.feed.cell),)

    async def cell(self, site: str, name: str) -> Cell:
        """One cell. Raises ``KeyError`` if there is no such cell, ``OutletError`` if it cannot be opened."""
        if self._cell is None or (site, name) not in self.names:
            raise KeyError(name)
        return self._cell

    def summary(self) -> list[dict[str, Any]]:
        """Figures of all cells, ready for JSON."""
        if self._cell is None:
            return []
        feed = self._cell.feed
        age = None if feed.live.heard is None else time.monotonic() - feed.live.heard
        return [plant_cell(feed.site, feed.cell, feed.live.status, age)]


log = logging.getLogger(__name__)

Body = Mapping[str, Any]


def plant_cell(site: str, cell: str, status: Body, age: float | None = None, *, gone: bool = False) -> dict[str, Any]:
    """Figures of a cell, ready for JSON; ``status``: its health, ``age`` s old, empty if the cell does not answer."""
    figures = summary(cell, status)
    known = {alarm["id"] for alarm in status.get("alarms", ()) if alarm.get("acknowledged")}
    return {
        "site": site,
        **figures,
        "state": "gone" if gone else figures["state"],
        "time": shapes.ms(figures["time"]),
        "age_s": age,
        "alarms": [
            {**alarm, "since": shapes.ms(alarm["since"]), "acknowledged": alarm["id"] in known}
            for alarm in figures["alarms"]
        ],
        "shelved": len(status.get("shelved", ())),
        "power_W": _of_kind(status.get("power_W"), int | float),
        "energy_today_J": _of_kind(status.get("energy_today_J"), int | float),
        "task": _of_kind(status.get("task"), str),
    }


def _of_kind(value: object, kind: Any) -> Any:
    """A value from a cell of any version, ``None`` if it is not of type ``kind``."""
    return value if isinstance(value, kind) else None


async def follow_arms(feed: Feed, arms: Mapping[str, Path]) -> None:
    """Update the arms of a feed when its channels change, until cancelled; log and skip arms that cannot be read."""
    while arms:
        await feed.laid_out.wait()
        feed.laid_out.clear()
        from cellwatt.outlets.page.skeleton import skeleton

        found = []
        for source, file in arms.items():
            try:
                found.append(await asyncio.to_thread(skeleton, source, file, feed.names))
            except (CellwattError, OSError, ValueError) as error:
                log.warning("the arm of %s is not shown: %s: %s", source, file, error)
        if found != feed.arms:
            feed.arms = found
            feed.hub.end()
