"""The position up to which a peer has the cell's entries, and the spans owed to it; in memory and in a file.

A moment is delivered, owed, or in the future. Owed entries are stored as spans of time, each with the number of
entries known to have been made in it. If the record later has fewer, the difference is counted as lost.
"""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path
from typing import Annotated, Final, NamedTuple

from pydantic import BaseModel, Field

from cellwatt.account import Account
from cellwatt.errors import why
from cellwatt.files import read_saved, replace_bytes

log = logging.getLogger(__name__)

MOST: Final = 256
"""Most owed spans. Beyond it, the two nearest spans are merged and the entries between them are sent again."""
EVERY: Final = 1.0
"""Shortest time between two writes of the file, s."""
GONE: Final = "no longer in the record"

Span = tuple[int, int]
"""Times (after, until], UTC ns."""


class Owed(NamedTuple):
    """A span that the peer lacks, and the number of entries known to have been made in it."""

    after: int
    until: int
    entries: int = 0


class Position(BaseModel):
    """Content of the file. Everything up to ``reached``, UTC ns, is delivered or owed.

    ``place`` is the peer, ``births`` the birth number of the next Sparkplug connection. ``ended``: nothing was sent
    after this was written.
    """

    place: str = ""
    reached: int | None = None
    gaps: list[Owed] = []
    births: Annotated[int, Field(ge=0, le=255)] = 0
    lost: int = 0
    ended: bool = False


class Cursor:
    """The position of one peer, stored in ``path``; in memory only if that is ``None``. Call ``open`` first.

    ``place`` identifies the peer: a stored position of another peer is ignored. ``problem`` is one line on why the
    file cannot be written, or ``None``. ``account`` counts expected, lost and owed entries.
    """

    def __init__(self, path: Path | None, account: Account, place: str = "") -> None:
        self.reached: int | None = None
        self.births = 0
        self.lost = 0
        """Total of owed entries that were no longer in the record."""
        self.ended = False
        """The stored position includes everything that was sent before this start."""
        self.problem: str | None = None
        self.lacking = asyncio.Event()
        """Set while entries are owed."""
        self._path, self._account, self._place = path, account, place
        self._owed: list[Owed] = []
        """Disjoint and in order."""
        self._counted = 0
        """Owed entries already counted in the account."""
        self._opened = False
        self._changed = asyncio.Event()
        self._writing = asyncio.Lock()

    # position -------------------------------------------------------------------------------------

    @property
    def entries(self) -> int:
        """Number of entries known to be owed."""
        return sum(o.entries for o in self._owed)

    @property
    def first(self) -> Span | None:
        """The oldest owed span."""
        return (self._owed[0].after, self._owed[0].until) if self._owed else None

    def deliver(self, time: int) -> None:
        """Note that everything up to ``time``, UTC ns, is delivered or owed."""
        if self.reached is None or time > self.reached:
            self.reached = time
            self._changed.set()

    def owe(self, after: int, until: int, entries: int = 0) -> None:
        """Add an owed span with ``entries`` new entries. Spans that touch or overlap are merged."""
        if until <= after:
            return
        apart = [o for o in self._owed if o.until < after or o.after > until]
        touching = [Owed(after, until, entries), *(o for o in self._owed if not (o.until < after or o.after > until))]
        first, last, counts = zip(*touching, strict=True)
        self._owed = sorted([*apart, Owed(min(first), max(last), sum(counts))])
        while len(self._owed) > MOST:
            at = min(range(len(self._owed) - 1), key=lambda i: self._owed[i + 1].after - self._owed[i].until)
            one, two = self._owed[at : at + 2]
            self._owed[at : at + 2] = [Owed(one.after, two.until, one.entries + two.entries)]
        self._note()

    def owe_since(self, until: int) -> None:
        """Owe everything between the position and ``until``, and move the position there."""
        if self.reached is not None:
            self.owe(self.reached, until)
        self.deliver(until)

    def pay(self, after: int, until: int, entries: int = 0) -> None:
        """Note that a span was delivered from the record, which had ``entries`` entries in it."""
        remaining: list[Owed] = []
        for o in self._owed:
            if o.until <= after or o.after >= until:
                remaining.append(o)
                continue
            known, entries = o.entries - entries, max(entries - o.entries, 0)
            sides = (o.after, min(o.until, after)), (max(o.after, until), o.until)
            rest = [Owed(start, end) for start, end in sides if start < end]
            if known > 0 and rest:
                rest[-1] = rest[-1]._replace(entries=known)
            elif known > 0:
                self.lost += known
                self._account.miss(known, GONE)
            remaining += rest
        self._account.expect(entries)  # entries that were not counted when they were made
        self._owed = remaining
        self._note()

    def _note(self) -> None:
        (self.lacking.set if self._owed else self.lacking.clear)()
        self._account.owed += self.entries - self._counted
        self._counted = self.entries
        self._changed.set()

    def born(self, births: int) -> None:
        """Store the birth number of the next connection."""
        self.births = births
        self._changed.set()

    # the file -------------------------------------------------------------------------------------

    async def open(self) -> None:
        """Read the file once; spans owed before this call remain owed."""
        if not self._opened:
            known = await asyncio.to_thread(load, self._path, self._place)
            since, self._opened = self._owed, True
            self._owed = [owed for owed in sorted(known.gaps) if owed.after < owed.until]
            self._account.expect(self.entries)
            self.reached = self.reached if known.reached is None else known.reached
            self.births, self.lost, self.ended = known.births, known.lost, known.ended
            for o in since:
                self.owe(*o)
        self._note()

    def succeed(self, before: Cursor) -> None:
        """Take over the position of ``before``, a closed cursor."""
        if before._path == self._path and before._place == self._place:
            self.reached, self.births, self.lost, self.ended = before.reached, before.births, before.lost, before.ended
            self._owed, self._opened = before._owed, before._opened
            self._account.expect(self.entries)
            self._note()

    async def keep(self) -> None:
        """Write the file after changes, until cancelled."""
        while True:
            await self._changed.wait()
            await self.write()
            await asyncio.sleep(EVERY)

    async def write(self, *, ended: bool = False) -> None:
        """Write the position if it has changed; ``ended``: it includes everything that was sent."""
        if ended:
            self.ended = True
            self._changed.set()
        if self._path is None or not self._opened or not self._changed.is_set():
            return
        self._changed.clear()
        position = Position(
            place=self._place, reached=self.reached, gaps=self._owed, births=self.births, lost=self.lost, ended=ended
        )
        # A cancelled write continues in its thread; the next one waits for it.
        await asyncio.shield(asyncio.ensure_future(self._write(self._path, position.model_dump_json().encode())))

    async def _write(self, path: Path, content: bytes) -> None:
        async with self._writing:
            try:
                await asyncio.to_thread(replace_bytes, path, content)
            except OSError as error:
                problem = f"{path} cannot be written, so rows may be sent twice after a restart: {why(error)}"
                if problem != self.problem:
                    log.warning("%s", problem)
                self._account.count("positions unwritten")
                self.problem = problem
                self._changed.set()
            else:
                self.problem = None


def load(path: Path | None, place: str = "") -> Position:
    """The position in a file; a new one if the file is absent, damaged, or of another peer."""
    lost = "rows from before this start are not sent"
    found = None if path is None else read_saved(path, Position.model_validate_json, lost)
    return found if found is not None and found.place == place else Position(place=place)
