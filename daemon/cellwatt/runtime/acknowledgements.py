"""Actions of people on alarms: acknowledge, shelve, unshelve. They outlast the process and the daemon.

Each action is an event, so the record and the journal have it. The file ``alarms.json`` beside the recordings holds
the state of all acknowledged and shelved alarms, including changes that were not published.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

from pydantic import BaseModel

from cellwatt.alarms import AlarmBook
from cellwatt.errors import CellwattError, why
from cellwatt.files import read_saved, replace_text
from cellwatt.results import Alarm, Event

FILE: Final = "alarms.json"
AGAIN: Final = 600 * 10**9
"""Time, ns, after the start of the daemon in which an alarm that is raised again is still acknowledged."""
LONGEST_SHELF: Final = 31 * 86_400 * 10**9
"""Longest time, ns, for which an alarm can be shelved."""
LONGEST_NAME, LONGEST_NOTE = 100, 2000  # characters


class _Saved(BaseModel):
    session: int
    alarms: list[dict[str, Any]]


class Acknowledgements:
    """Applies the actions of people to the alarm book.

    ``say`` records and publishes an event, ``publish`` the messages of the book. Without calls of ``keep`` the
    acknowledgements and shelves end with the daemon.
    """

    def __init__(
        self,
        book: AlarmBook,
        session: int,
        now: Callable[[], int],
        say: Callable[[Event], None],
        publish: Callable[[list[Alarm]], None],
    ) -> None:
        self._book, self._session, self._now, self._take, self._publish = book, session, now, say, publish
        self.changed = asyncio.Event()
        """Set by an action of a person until ``keep`` runs."""
        self._written: list[Any] = []

    def acknowledge(self, alarm_id: str, name: str, note: str) -> None:
        """See ``CellView.acknowledge``."""
        name, note = _person(name), _short(note)
        self._book.acknowledge(alarm_id, name, note, self._now())
        self._report("acknowledged", alarm_id, name, note)

    def shelve(self, alarm_id: str, until: int, name: str, note: str) -> None:
        """See ``CellView.shelve``."""
        name, note, now = _person(name), _short(note), self._now()
        if not now < until <= now + LONGEST_SHELF:
            raise CellwattError("an alarm can be shelved for up to 31 days from now")
        self._book.shelve(alarm_id, until, name, note, now)
        self._report("shelved", alarm_id, name, note, until=until)

    def unshelve(self, alarm_id: str, name: str) -> None:
        """See ``CellView.unshelve``."""
        name = _person(name)
        back = self._book.unshelve(alarm_id, self._now())
        self._report("unshelved", alarm_id, name, "")
        self._publish(back)

    def _report(self, kind: str, alarm_id: str, name: str, note: str, **more: int) -> None:
        text = f"{name} {kind} {alarm_id}{': ' if note else ''}{note}"
        alarm = self._book[alarm_id].alarm if alarm_id in self._book else None
        source = alarm.source if alarm is not None else None
        self._take(Event(self._now(), source, kind, text, {"alarm": alarm_id, "name": name, "note": note, **more}))
        self.changed.set()

    # the file -------------------------------------------------------------------------------------

    def read(self, folder: Path) -> None:
        """Restore acknowledgements and shelves from the file. An unreadable file is logged and ignored."""
        read_saved(folder / FILE, self._restore, "acknowledgements and shelves are lost")

    def _restore(self, content: bytes) -> None:
        saved = _Saved.model_validate_json(content)
        if saved.session == self._session:
            self._book.adopt(standing for standing in saved.alarms if standing.get("shelf"))
        else:
            self._book.expect(saved.alarms, self._now() + AGAIN)

    def write_again(self) -> None:
        """Have ``keep`` write the file again, because it is gone."""
        self._written = []
        self.changed.set()

    async def keep(self, folder: Path) -> str | None:
        """Write acknowledgements and shelves if they have changed; return the reason if that fails."""
        self.changed.clear()
        words = self._book.words()
        if words == self._written:
            return None
        try:
            await asyncio.to_thread(
                replace_text, folder / FILE, json.dumps({"session": self._session, "alarms": words})
            )
        except OSError as error:
            return f"{folder / FILE} cannot be written: {why(error)}"
        self._written = words
        return None


def _person(name: str) -> str:
    name = " ".join(name.split())
    if not name:
        raise CellwattError("enter your name: it is empty")
    if len(name) > LONGEST_NAME:
        raise CellwattError(f"a name has at most {LONGEST_NAME} characters")
    return name


def _short(note: str) -> str:
    if len(note) > LONGEST_NOTE:
        raise CellwattError(f"a note has at most {LONGEST_NOTE} characters")
    return note.strip()
