"""One outlet at run time: restarted when it ends, and isolated when it fails."""

from __future__ import annotations

import asyncio
import logging
import time
from collections.abc import Callable, Mapping
from typing import Any, TypeVar

from cellwatt.account import Account
from cellwatt.errors import OutletError
from cellwatt.host import blank
from cellwatt.outlet import Item, Outlet
from cellwatt.runtime.allowance import one_line
from cellwatt.runtime.tasks import end_of

log = logging.getLogger(__name__)

T = TypeVar("T")

FIRST_PAUSE, LONGEST_PAUSE = 0.5, 30.0  # s
STEADY = 15.0
"""A run that lasted this long, s, counts as working: a peer may take 10 s to refuse a session."""


class Delivery:
    """The daemon's side of one outlet: its exceptions reach neither the sources nor other outlets.

    ``make`` creates the outlet, which takes over from that of ``before``. If this fails, ``run`` tries again, unless
    the outlet is ``required``; items offered meanwhile are lost and counted.
    """

    def __init__(
        self, name: str, make: Callable[[], Outlet[Any]], before: Delivery | None = None, *, required: bool = False
    ) -> None:
        self.name = name
        self._make = make
        self._before: Outlet[Any] | None = None if before is None else before._outlet or before._before
        self._outlet: Outlet[Any] | None = None
        self._account = Account()
        self._ended: str | None = None
        self._serves_from = 0.0
        """Monotonic s from which the present run counts as working, and the reason of the last end is dropped."""
        self._broke: str | None = None
        self._logged: str | None = None
        try:
            self._made()
        except Exception:
            if required:
                raise

    def _made(self) -> Outlet[Any]:
        if self._outlet is None:
            self._outlet = self._make()
            self._account = self._outlet.account
            before, self._before = self._before, None
            if before is not None:
                self._contained("predecessors lost", lambda outlet: outlet.succeed(before))
        return self._outlet

    def offer(self, item: Item) -> None:
        """Pass on one item; if the outlet fails with it, the item is lost and counted."""
        if self._outlet is None:
            self._account.count("items lost")
        self._contained("items lost", lambda outlet: outlet.offer(item))

    @property
    def awaited(self) -> bool:
        """See ``Outlet.awaited``."""
        return bool(self._contained("looks lost", lambda outlet: outlet.awaited))

    def health(self, status: Mapping[str, Any]) -> None:
        """Pass on the cell's health."""
        self._contained("health lost", lambda outlet: outlet.health(status))

    def _contained(self, what: str, work: Callable[[Outlet[Any]], T]) -> T | None:
        try:
            return None if self._outlet is None else work(self._outlet)
        except Exception as error:
            self._account.count(what)
            self._broke = blank(f"{type(error).__name__}: {error}")
            if self._broke != self._logged:
                self._logged = self._broke
                log.exception("outlet %s failed; the item given to it is lost", self.name)
            return None

    async def run(self) -> None:
        """Run the outlet until cancelled; restart it after each end."""
        pause = FIRST_PAUSE / 2
        while True:
            began = time.monotonic()
            self._serves_from = began + STEADY
            end = await end_of(self._run, OutletError, f"outlet {self.name} failed")
            error = OutletError("it ended without being stopped") if end is None else end
            if time.monotonic() - began > STEADY:
                pause = FIRST_PAUSE / 2
            pause = min(2 * pause, LONGEST_PAUSE)
            text = str(error) if isinstance(error, OutletError) else f"{type(error).__name__}: {error}"
            self._ended = one_line(blank(text))
            self._serves_from = float("inf")
            log.warning("outlet %s: %s; trying again in %.1f s", self.name, self._ended, pause)
            await asyncio.sleep(pause)

    async def _run(self) -> None:
        await self._made().run()

    def status(self) -> dict[str, Any]:
        """Figures for health, JSON-ready; each call resets the failure noted since the last call."""
        trouble = self._contained("looks lost", lambda outlet: outlet.trouble())
        broke, self._broke = self._broke, None
        if time.monotonic() > self._serves_from:
            self._ended = None
        error = one_line(self._ended or broke or trouble or "") or None
        well = "starting" if self._contained("looks lost", lambda outlet: outlet.starting()) else "ok"
        where = {} if self._outlet is None or self._outlet.url is None else {"url": self._outlet.url}
        return {"state": "down" if error else well, "error": error, **where, **self._account.snapshot()}
