"""The cells that a page shows, each with its feed, its record and the way to act on it."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal, Protocol
from urllib.parse import quote

from cellwatt.outlets.page.archive import Archive
from cellwatt.outlets.page.feed import Feed
from cellwatt.outlets.page.streams import Hub
from cellwatt.outlets.page.summary import plant_cell

Mode = Literal["cell", "plant", "recordings"]

Order = Callable[[Mapping[str, Any]], Awaitable[None]]
"""Has the cell's daemon do something; raises ``CellwattError`` with its reason."""


@dataclass(slots=True)
class Room:
    """One cell; ``order`` is ``None`` where nothing can be changed from here."""

    feed: Feed
    archive: Archive
    order: Order | None = None


class Rooms(Protocol):
    """All cells of a page."""

    mode: Mode
    site: str | None
    acts: bool
    """True if anything can be changed from here."""

    @property
    def cells(self) -> Sequence[tuple[str, str]]:
        """Site and name of each cell."""
        ...

    async def room(self, site: str, cell: str) -> Room:
        """The room of a cell. Raises ``KeyError`` if there is no such cell, ``OutletError`` if it cannot be opened."""
        ...

    def summary(self) -> list[dict[str, Any]]:
        """All cells in figures, JSON-ready."""
        ...

    @property
    def hub(self) -> Hub | None:
        """The changes of ``summary``; ``None`` where there is one cell."""
        ...

    def url_of(self, site: str, cell: str) -> str | None:
        """Address of the cell's own page, if it is known."""
        ...


def prefix(site: str, cell: str) -> str:
    """Path of the answers about a cell."""
    return f"/api/cells/{quote(site, safe='')}/{quote(cell, safe='')}"


class OneRoom:
    """A page of one cell; of none, on which recordings can be dropped."""

    hub: Hub | None = None

    def __init__(self, room: Room | None) -> None:
        self._room = room
        self.mode: Mode = "recordings" if room is None else "cell"
        self.site: str | None = None if room is None else room.feed.site
        self.acts = room is not None and room.order is not None

    @property
    def cells(self) -> Sequence[tuple[str, str]]:
        """See ``Rooms.cells``."""
        return () if self._room is None else ((self._room.feed.site, self._room.feed.cell),)

    async def room(self, site: str, cell: str) -> Room:
        """See ``Rooms.room``."""
        if self._room is None or (site, cell) not in self.cells:
            raise KeyError(cell)
        return self._room

    def summary(self) -> list[dict[str, Any]]:
        """See ``Rooms.summary``."""
        if self._room is None:
            return []
        feed = self._room.feed
        age = None if feed.live.heard is None else time.monotonic() - feed.live.heard
        task = None if feed.live.task is None else feed.live.task["name"]
        return [plant_cell(feed.site, feed.cell, feed.live.status, age_s=age, task=task)]

    def url_of(self, site: str, cell: str) -> str | None:
        """See ``Rooms.url_of``."""
        return None
