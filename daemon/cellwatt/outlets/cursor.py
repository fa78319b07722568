"""How far a peer has what a cell made, and what it is owed: the only owner of that, in memory and in its file.

A moment is delivered, owed, or not made yet. What is owed stands in spans of time, and each span says how many entries
were made in it while somebody counted: where the record has fewer when it is read, the others are lost, and counted.
"""

from __future__ import annotations

import asyncio
import logging
from pathlib import Path
from typing import Annotated, Final, NamedTuple

from pydantic import AliasChoices, BaseModel, ConfigDict, Field, ValidationError

from cellwatt.account import Account
from cellwatt.errors import why
from cellwatt.files import read_bytes, replace_bytes

log = logging.getLogger(__name__)

MOST: Final = 256
"""Spans that are remembered apart; beyond that the nearest two become one, and what lies between is sent again."""
EVERY: Final = 1.0
"""s between two writings of the file."""
GONE: Final = "no longer in the record"

Span = tuple[int, int]
"""Times, UTC ns: after the first, up to and with the second."""


class Owed(NamedTuple):
    """A span that the peer lacks, and how many entries are known to have been made in it."""

    after: int
    until: int
    entries: int = 0


class Position(BaseModel):
    """What the file holds. All up to ``reached``, UTC ns, is delivered or owed.

    ``place`` is the peer, ``births`` the number of Sparkplug's next connection, ``ended`` is true where nothing was
    said after this was written; ``gaps`` have also the form of before.
    """

    model_config = ConfigDict(extra="ignore", populate_by_name=True)

    place: str = ""
    reached: int | None = Field(default=None, validation_alias=AliasChoices("reached", "until"))
    gaps: list[Owed] = []
    births: Annotated[int, Field(ge=0, le=255)] = 0
    lost: int = 0
    ended: bool = False


class Cursor:
    """Keeps the position of one peer in ``path``; in memory alone where that is ``None``. ``open`` comes first.

    ``place`` tells peers apart: of another one nothing is known. ``problem`` is one line on why the file cannot be
    written, or ``None``. ``account`` has its expected entries, those lost, and how many are owed.
    """

    def __init__(self, path: Path | None, account: Account, place: str = "") -> None:
        self.reached: int | None = None
        self.births = 0
        self.lost = 0
        """Entries that the record did not have any more, ever."""
        self.ended = False
        """All that was said before this start is in the position."""
        self.problem: str | None = None
        self.lacking = asyncio.Event()
        """Something is owed."""
        self._path, self._account, self._place = path, account, place
        self._owed: list[Owed] = []
        self._counted = 0
        """Entries owed as the account knows them."""
        self._opened = False
        self._changed = asyncio.Event()
        self._writing = asyncio.Lock()

    # what is known --------------------------------------------------------------------------------

    @property
    def owed(self) -> list[Span]:
        """Disjoint spans in order."""
        return [(o.after, o.until) for o in self._owed]

    @property
    def entries(self) -> int:
        """Entries that are known to be owed."""
        return sum(o.entries for o in self._owed)

    @property
    def first(self) -> Span | None:
        """The oldest span that is owed."""
        return (self._owed[0].after, self._owed[0].until) if self._owed else None

    def deliver(self, time: int) -> None:
        """Note that all up to ``time`` is delivered, or owed."""
        if self.reached is None or time > self.reached:
            self.reached = time
            self._changed.set()

    def owe(self, after: int, until: int, entries: int = 0) -> None:
        """Note what is not delivered; ``entries`` of it were made just now. What touches becomes one span."""
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
        """Note that what was made since the position up to ``until`` is not delivered; it goes on from there."""
        if self.reached is not None:
            self.owe(self.reached, until)
        self.deliver(until)

    def pay(self, after: int, until: int, entries: int = 0) -> None:
        """Note that a span is delivered out of the record, which had ``entries`` of it."""
        left: list[Owed] = []
        for o in self._owed:
            if o.until <= after or o.after >= until:
                left.append(o)
                continue
            known, entries = o.entries - entries, max(entries - o.entries, 0)
            sides = (o.after, min(o.until, after)), (max(o.after, until), o.until)
            rest = [Owed(start, end) for start, end in sides if start < end]
            if known > 0 and rest:
                rest[-1] = rest[-1]._replace(entries=known)
            elif known > 0:
                self.lost += known
                self._account.miss(known, GONE)
            left += rest
        self._account.expect(entries)  # nobody counted them when they were made
        self._owed = left
        self._note()

    def _note(self) -> None:
        (self.lacking.set if self._owed else self.lacking.clear)()
        self._account.owed += self.entries - self._counted
        self._counted = self.entries
        self._changed.set()

    def born(self, births: int) -> None:
        """Note the number of the next connection."""
        self.births = births
        self._changed.set()

    # the file -------------------------------------------------------------------------------------

    async def open(self) -> None:
        """Read the file, once; what was owed meanwhile stays owed."""
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
        """Take over from the cursor before this one, which is closed."""
        if before._path == self._path and before._place == self._place:
            self.reached, self.births, self.lost, self.ended = before.reached, before.births, before.lost, before.ended
            self._owed, self._opened = before._owed, before._opened
            self._account.expect(self.entries)
            self._note()

    async def keep(self) -> None:
        """Write what changes, until cancelled."""
        while True:
            await self._changed.wait()
            await self.write()
            await asyncio.sleep(EVERY)

    async def write(self, *, ended: bool = False) -> None:
        """Write the position as it is, if it changed since it was read; ``ended``: all that was said is in it."""
        if ended:
            self.ended = True
            self._changed.set()
        if self._path is None or not self._opened or not self._changed.is_set():
            return
        self._changed.clear()
        told = Position(
            place=self._place, reached=self.reached, gaps=self._owed, births=self.births, lost=self.lost, ended=ended
        )
        # A cancelled write goes on in its thread; the next waits for it.
        await asyncio.shield(asyncio.ensure_future(self._write(self._path, told.model_dump_json().encode())))

    async def _write(self, path: Path, content: bytes) -> None:
        async with self._writing:
            try:
                await asyncio.to_thread(replace_bytes, path, content)
            except OSError as error:
                problem = f"{path} cannot be written, so a restart may send some twice: {why(error)}"
                if problem != self.problem:
                    log.warning("%s", problem)
                self._account.count("positions unwritten")
                self.problem = problem
                self._changed.set()
            else:
                self.problem = None


def load(path: Path | None, place: str = "") -> Position:
    """The position in a file; a new one where there is none, it is damaged, or of another place."""
    if path is None:
        return Position(place=place)
    try:
        found = Position.model_validate_json(read_bytes(path))
    except FileNotFoundError:
        return Position(place=place)
    except (OSError, ValidationError) as error:
        reason = why(error) if isinstance(error, OSError) else "it is damaged"
        log.warning("%s cannot be read (%s): nothing from before this start is sent later", path, reason)
        return Position(place=place)
    return found if found.place == place else Position(place=place)
