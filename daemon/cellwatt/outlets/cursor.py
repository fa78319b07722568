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

    ``place`` is the peer, ``gaps`` what it lacks: disjoint spans, in order; ``births`` the birth number of the next
    Sparkplug connection, ``lost`` the total of owed entries that were no longer in the record. ``ended``: nothing was
    sent after this was written.
    """

    place: str = ""
    reached: int | None = None
    gaps: list[Owed] = []
    births: Annotated[int, Field(ge=0, le=255)] = 0
    lost: int = 0
    ended: bool = False


class Cursor:
    """The ``position`` of one peer, stored in ``path``; in memory only if that is ``None``. Call ``open`` first.

    ``place`` identifies the peer: a stored position of another peer is ignored. ``problem`` is one line on why the
    file cannot be written, or ``None``. ``account`` counts expected, lost and owed entries.
    """

    def __init__(self, path: Path | None, account: Account, place: str = "") -> None:
        self.position = Position(place=place)
        self.problem: str | None = None
        self.lacking = asyncio.Event()
        """Set while entries are owed."""
        self._path, self._account = path, account
        self._counted = 0
        """Owed entries already counted in the account."""
        self._opened = False
        self._changed = asyncio.Event()
        self._writing = asyncio.Lock()

    # position -------------------------------------------------------------------------------------

    @property
    def entries(self) -> int:
        """Number of entries known to be owed."""
        return sum(o.entries for o in self.position.gaps)

    @property
    def first(self) -> Span | None:
        """The oldest owed span."""
        return self.position.gaps[0][:2] if self.position.gaps else None

    def deliver(self, time: int) -> None:
        """Note that everything up to ``time``, UTC ns, is delivered or owed."""
        reached = self.position.reached
        if reached is None or time > reached:
            self.position.reached = time
            self._changed.set()

    def owe(self, after: int, until: int, entries: int = 0) -> None:
        """Add an owed span with ``entries`` new entries. Spans that touch or overlap are merged."""
        if until <= after:
            return
        gaps = self.position.gaps
        near = [o for o in gaps if o.until >= after and o.after <= until]
        first, last, counts = zip(Owed(after, until, entries), *near, strict=True)
        gaps = sorted([*(o for o in gaps if o not in near), Owed(min(first), max(last), sum(counts))])
        while len(gaps) > MOST:
            at = min(range(len(gaps) - 1), key=lambda i: gaps[i + 1].after - gaps[i].until)
            one, two = gaps[at : at + 2]
            gaps[at : at + 2] = [Owed(one.after, two.until, one.entries + two.entries)]
        self.position.gaps = gaps
        self._note()

    def owe_since(self, until: int) -> None:
        """Owe everything between the position and ``until``, and move the position there."""
        if self.position.reached is not None:
            self.owe(self.position.reached, until)
        self.deliver(until)

    def pay(self, after: int, until: int, entries: int = 0) -> None:
        """Note that a span was delivered from the record, which had ``entries`` entries in it."""
        remaining: list[Owed] = []
        for o in self.position.gaps:
            if o.until <= after or o.after >= until:
                remaining.append(o)
                continue
            known, entries = o.entries - entries, max(entries - o.entries, 0)
            sides = (o.after, min(o.until, after)), (max(o.after, until), o.until)
            rest = [Owed(start, end) for start, end in sides if start < end]
            if known > 0 and rest:
                rest[-1] = rest[-1]._replace(entries=known)
            elif known > 0:
                self.position.lost += known
                self._account.miss(known, GONE)
            remaining += rest
        self._account.expect(entries)  # entries that were not counted when they were made
        self.position.gaps = remaining
        self._note()

    def _note(self) -> None:
        (self.lacking.set if self.position.gaps else self.lacking.clear)()
        self._account.owed += self.entries - self._counted
        self._counted = self.entries
        self._changed.set()

    def born(self, births: int) -> None:
        """Store the birth number of the next connection."""
        self.position.births = births
        self._changed.set()

    # the file -------------------------------------------------------------------------------------

    async def open(self) -> None:
        """Read the file once; spans owed before this call remain owed."""
        if not self._opened:
            known = await asyncio.to_thread(load, self._path, self.position.place)
            since, self.position, self._opened = self.position, known, True
            known.gaps = [owed for owed in sorted(known.gaps) if owed.after < owed.until]
            self._account.expect(self.entries)
            known.reached = since.reached if known.reached is None else known.reached
            for o in since.gaps:
                self.owe(*o)
        self._note()

    def succeed(self, before: Cursor) -> None:
        """Take over the position of ``before``, a closed cursor."""
        if before._path == self._path and before.position.place == self.position.place:
            self.position, self._opened = before.position.model_copy(), before._opened
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
            self.position.ended = True
            self._changed.set()
        if self._path is None or not self._opened or not self._changed.is_set():
            return
        self._changed.clear()
        position = self.position.model_copy(update={"ended": ended})
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
