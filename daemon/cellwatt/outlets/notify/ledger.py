"""The delivery state of each recipient and mail address, in a file that survives a crash: ``notify.jsonl``.

One line for each; each change is on disk before a message depends on it.
"""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Collection
from pathlib import Path
from typing import Final

from cellwatt.errors import why
from cellwatt.files import COMPUTED, read_bytes, replace_bytes
from cellwatt.outlets.notify.rules import Recipient

log = logging.getLogger(__name__)

FILE: Final = "notify.jsonl"


class Ledger:
    """State of each, by its key in ``NotifySettings.each``; without a path in memory only."""

    def __init__(self, path: Path | None) -> None:
        self.path = path
        self.states: dict[str, Recipient] = {}
        self.problem: str | None = None
        """Reason why the file is not up to date, or ``None``; each change writes it again."""
        self.unreadable = 0
        """Number of lines that this version cannot read."""
        self._changed = True
        self._turn = asyncio.Lock()

    def read(self) -> None:
        """Read the file, if there is one. Blocks."""
        if self.path is None:
            return
        try:
            content = read_bytes(self.path, COMPUTED)
        except FileNotFoundError:
            return
        except OSError as error:
            self.problem = f"{self.path} cannot be read: {why(error)}"
            return
        for line in content.splitlines():
            try:
                name, saved = json.loads(line)
                self.states[str(name)] = Recipient.read(saved)
            except (ValueError, TypeError, RecursionError):  # pydantic raises ValueError, too
                self.unreadable += 1

    def of(self, name: str) -> Recipient:
        """State of a recipient, a new one if there is none."""
        return self.states.setdefault(name, Recipient())

    def keep(self, names: Collection[str]) -> dict[str, int]:
        """Delete the state of all other recipients; return the number of undelivered items of each."""
        gone = {name: self.states.pop(name) for name in list(self.states) if name not in names}
        self._changed = self._changed or bool(gone)
        lost = {name: len(state.due) + len(state.flight.items if state.flight else ()) for name, state in gone.items()}
        return {name: count for name, count in lost.items() if count}

    async def flush(self) -> None:
        """Return once the state is on disk, or ``problem`` is set to the reason why it is not."""
        async with self._turn:
            if not self._changed and not any(state.changed for state in self.states.values()):
                return
            self._changed = False
            for state in self.states.values():
                state.changed = False
            if self.path is None:
                return
            content = "".join(json.dumps([name, state.saved()]) + "\n" for name, state in self.states.items())
            work = asyncio.create_task(asyncio.to_thread(self._write, self.path, content.encode()))
            try:
                await asyncio.shield(work)
            except asyncio.CancelledError:
                await asyncio.wait([work])  # a write that has begun is completed
                raise

    def _write(self, path: Path, content: bytes) -> None:
        try:
            replace_bytes(path, content, 0o600)
        except OSError as error:
            self._changed = True
            problem = f"{path} cannot be written, so alarms may be sent again after a restart: {why(error)}"
            if problem != self.problem:
                log.warning("%s", problem)
            self.problem = problem
        else:
            self.problem = None
