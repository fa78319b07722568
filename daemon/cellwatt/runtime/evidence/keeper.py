"""Has evidence packs made: notes due packs on disk, waits for the time after the alarm, starts the process."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
import time
from collections.abc import Callable, Iterable
from typing import Any, Final

from cellwatt.child import output
from cellwatt.errors import CellwattError, why
from cellwatt.record import RecordSettings, packs
from cellwatt.record.folder import Stored
from cellwatt.record.header import PART
from cellwatt.record.packs import Due
from cellwatt.results import Alarm, Event

log = logging.getLogger(__name__)

LOOK: Final = 0.5
"""Delay in s between the time when the record has written the end of a pack and the making of the pack."""
LONGEST_LOOK: Final = 10.0
"""Longest time, s, between checks for due packs: the cell's clock may be set."""
RETAIN_EVERY: Final = 3600.0
"""Period, s, at which packs are compared with their age."""
LIMIT: Final = 300.0
"""Longest time, s, for making one pack."""
CLOSE: Final = 4.0
"""Longest time, s, that the end of the daemon waits for packs; the next start makes the others."""
NICENESS: Final = 19
"""Niceness of the process that makes a pack: the lowest priority."""
MODULE: Final = "cellwatt.runtime.evidence.making"


class Keeper:
    """The packs of one cell. ``alarm`` is called on the event loop and only notes; ``run`` has the packs made.

    ``now`` is the cell's clock, UTC ns; ``tell`` is called with the event that names a pack's file, or the reason why
    there is none. ``known`` are alarms that were active before this process: their packs are noted on disk.
    """

    def __init__(
        self,
        settings: RecordSettings,
        cell: str,
        now: Callable[[], int],
        tell: Callable[[Event], None],
        known: Iterable[Alarm] = (),
    ) -> None:
        self._settings, self._cell, self._now, self._tell = settings, cell, now, tell
        self.folder = settings.folder / packs.FOLDER
        self._waiting: list[Due] = []
        self._making: Due | None = None
        """The last of them that was begun: its end is fixed, and no more alarms join it."""
        self._unwritten: set[str] = set()
        """Names of packs whose note on disk is out of date."""
        self._seen = {alarm.id: alarm.since for alarm in known if packs.wants(settings.evidence, alarm)}
        """``since`` of each active alarm that has a pack, by alarm id."""
        self._writing: asyncio.Future[None] | None = None
        """The last write of a note; if ``run`` is cancelled, it goes on."""
        self._noted = asyncio.Event()
        self._stored: list[Stored] = []
        self._retained_at = -RETAIN_EVERY
        self._made = self._given_up = 0
        self._problem = ""

    def alarm(self, alarm: Alarm) -> None:
        """Note an alarm message: a raise, or a rise to a severity that gets a pack, makes a pack due."""
        if not alarm.active:
            self._seen.pop(alarm.id, None)
            return
        if not packs.wants(self._settings.evidence, alarm) or self._seen.get(alarm.id) == alarm.since:
            return
        self._seen[alarm.id] = alarm.since
        for place, due in enumerate(self._waiting):
            if due is not self._making and (joined := due.joined(alarm, self._settings.evidence)) is not None:
                self._waiting[place] = joined
                break
        else:
            joined = Due.of(self._cell, alarm, self._settings.evidence)
            self._waiting.append(joined)
        self._unwritten.add(joined.name)
        self._noted.set()

    async def run(self) -> None:
        """Make packs when they are due, also those left by an earlier daemon, until cancelled."""
        await self._resume()
        while True:
            await self._write()
            await self._retain()
            late = self._now() - round(1e9 * (self._settings.flush + LOOK))  # the record has written samples up to then
            due = next((due for due in self._waiting if due.end <= late), None)
            if due is not None:
                await self._make(due)
                continue
            self._noted.clear()
            with contextlib.suppress(TimeoutError):
                ahead = min((1e-9 * (due.end - late) for due in self._waiting), default=LONGEST_LOOK)
                async with asyncio.timeout(min(ahead, LONGEST_LOOK)):
                    await self._noted.wait()

    async def close(self) -> None:
        """Make the remaining packs from the data recorded so far, after ``run`` and the record have ended."""
        if self._writing is not None:
            await asyncio.wait([self._writing])  # two threads cannot replace the same file
        await self._write()
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(CLOSE):
                for due in list(self._waiting):
                    await self._make(due)

    def stats(self) -> dict[str, Any]:
        """Figures for health messages; sizes in bytes."""
        return {
            "packs": len(self._stored),
            "bytes": sum(pack.size for pack in self._stored),
            "waiting": len(self._waiting),
            "made": self._made,
            "given_up": self._given_up,
            "problem": self._problem,
        }

    async def _resume(self) -> None:
        try:
            earlier = await asyncio.to_thread(packs.all_due, self.folder, self._cell)
        except OSError as error:
            self._problem = f"{self.folder} cannot be read: {error.strerror}"
            return
        known = {due.name for due in self._waiting}
        self._waiting[:0] = [due for due in earlier if due.name not in known]

    async def _write(self) -> None:
        """Write the notes of due packs to disk."""
        while (due := next((due for due in self._waiting if due.name in self._unwritten), None)) is not None:
            self._unwritten.discard(due.name)
            try:
                self._writing = asyncio.ensure_future(asyncio.to_thread(packs.write_due, self.folder, due))
                await asyncio.shield(self._writing)
            except (OSError, ValueError) as error:  # the latter: a text that is no UTF-8
                self._waiting = [other for other in self._waiting if other.name != due.name]
                reason = why(error) if isinstance(error, OSError) else "its alarm cannot be encoded"
                self._give_up(due, f"{self.folder} cannot be written: {reason}")

    async def _retain(self) -> None:
        if time.monotonic() - self._retained_at < RETAIN_EVERY:
            return
        self._retained_at = time.monotonic()
        settings = self._settings.evidence
        try:
            now = min(time.time(), self._now() / 1e9)  # a PC's clock that leaps ahead makes no pack old
            self._stored = await asyncio.to_thread(packs.retain, self.folder, self._cell, settings, now)
        except OSError as error:
            self._problem = f"old packs cannot be removed: {error.strerror}"

    async def _make(self, due: Due) -> None:
        made: dict[str, Any] = {}
        failure, self._making = "", due
        try:
            if not await asyncio.to_thread(packs.due_path(self.folder, due).exists):  # removed with its folder
                await asyncio.to_thread(packs.write_due, self.folder, due)
            made = await self._made_by_process(due)
        except OSError as error:
            failure = f"{self.folder} cannot be written: {error.strerror}"
        except CellwattError as error:
            failure = str(error)
        except Exception as error:
            # A fault in making a pack must not stop this process, which also records.
            log.exception("evidence of alarm %s", due.alarms[0].id)
            failure = f"{type(error).__name__}: {error}"
        self._waiting = [other for other in self._waiting if other.name != due.name]
        for left in (packs.due_path(self.folder, due), self.folder / f"{due.name}.mcap{PART}"):
            with contextlib.suppress(OSError):
                await asyncio.to_thread(left.unlink, missing_ok=True)
        self._retained_at = -RETAIN_EVERY
        if failure:
            self._give_up(due, failure)
            return
        self._made += 1
        self._problem = made["problem"]
        self._say(due, f"stored in {packs.FOLDER}/{due.name}.mcap", {**made, "pack": f"{due.name}.mcap"})

    async def _made_by_process(self, due: Due) -> dict[str, Any]:
        """Run the process that makes a pack; return its report. Raises ``CellwattError`` if it fails."""
        note = str(packs.due_path(self.folder, due))
        printed = await output([MODULE, note, "--reserve", str(self._settings.file_limit)], LIMIT, NICENESS)
        found: dict[str, Any] = json.loads(printed.splitlines()[-1])
        return found

    def _give_up(self, due: Due, reason: str) -> None:
        self._given_up += 1
        self._problem = reason
        log.warning("evidence of alarm %s is not stored: %s", due.alarms[0].id, reason)
        self._say(due, f"not stored: {reason}", {})

    def _say(self, due: Due, what: str, data: dict[str, Any]) -> None:
        first = due.alarms[0]
        others = len(due.alarms) - 1 + due.more
        text = f"evidence of alarm {first.id}{f' and {others} more' if others else ''} {what}"
        alarms = [alarm.id for alarm in due.alarms]
        self._tell(Event(self._now(), first.source, "evidence", text, {"alarms": alarms, **data}))
