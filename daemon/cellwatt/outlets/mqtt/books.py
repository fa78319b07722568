"""The ledger of an outlet in its file, which is written aside the event loop as soon as it changes."""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path

from cellwatt.account import Account
from cellwatt.errors import why
from cellwatt.outlets.mqtt.ledger import Ledger, Span, dump, load, save

log = logging.getLogger(__name__)


class Books:
    """Keeps the ledger in ``path``; where that is ``None``, no rows, and in memory alone. ``open`` comes first.

    ``problem`` is one line on why the file cannot be written, or ``None``.
    """

    def __init__(self, path: Path | None, account: Account) -> None:
        self.ledger = Ledger()
        self.problem: str | None = None
        self._path = path
        self._account = account
        self._opened = False
        self._changed = asyncio.Event()
        self._writing = asyncio.Lock()
        self.owed = asyncio.Event()
        """There is a gap."""

    async def open(self) -> None:
        """Read the file, once."""
        if not self._opened:
            self.ledger = await asyncio.to_thread(load, self._path)
            self._opened = True
        self._note(0)

    def succeed(self, before: Books) -> None:
        """Take over from the books before these, which are closed."""
        self.ledger, self._opened = before.ledger, before._opened

    @property
    def gap(self) -> Span | None:
        """The first span of rows that were not delivered."""
        return self.ledger.gaps[0] if self.ledger.gaps else None

    def delivered(self, time: int, before: int) -> None:
        """Note a live row, and the time of the one before it."""
        if self._path is not None:
            self._note(self.ledger.delivered(time, before))

    def owe(self, until: int) -> None:
        """Note that rows up to ``until`` ns were made."""
        if self._path is not None:
            self._note(self.ledger.owe(until))

    def filled(self, time: int, until: int) -> None:
        """Note that the gap that ends at ``until`` is filled up to ``time``."""
        self.ledger.filled(time, until)
        self._note(0)

    def born(self, births: int) -> None:
        """Note the number of the next connection."""
        self.ledger.births = births
        self._note(0)

    def _note(self, lost: int) -> None:
        if lost:
            self._account.count("spans given up", lost)
        (self.owed.set if self.gap is not None else self.owed.clear)()
        self._changed.set()

    async def keep(self) -> None:
        """Write each change, until cancelled."""
        while True:
            await self._changed.wait()
            await self.write()

    async def write(self) -> None:
        """Write the ledger as it is."""
        self._changed.clear()
        if self._path is None:
            return
        # A cancelled write goes on in its thread; the next waits for it.
        await asyncio.shield(asyncio.ensure_future(self._write(self._path, dump(self.ledger))))

    async def _write(self, path: Path, text: str) -> None:
        async with self._writing:
            try:
                await asyncio.to_thread(save, path, text)
            except OSError as error:
                problem = f"{path} cannot be written, so a restart may send rows twice: {why(error)}"
                if problem != self.problem:
                    log.warning("%s", problem)
                self._account.count("positions unwritten")
                self.problem = problem
            else:
                self.problem = None
