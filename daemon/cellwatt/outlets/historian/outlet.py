"""Keeps the history of a cell elsewhere: in InfluxDB, and by a process, again and again, in a lake of Parquet files."""

from __future__ import annotations

import asyncio
import contextlib
import json
import logging
from collections import Counter
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar, Final

from cellwatt.account import Account
from cellwatt.child import output
from cellwatt.errors import CellwattError, OutletError, why
from cellwatt.files import put_aside
from cellwatt.outlet import CellView, Item, Outlet, revealed
from cellwatt.outlets.cursor import Cursor
from cellwatt.outlets.forward import Forwarder, Peer, framed_record
from cellwatt.outlets.historian.client import Client, result_line, row_line
from cellwatt.outlets.historian.settings import HistorianSettings, LakeSettings
from cellwatt.outlets.past import Archived
from cellwatt.outlets.remote import NotNowError
from cellwatt.outlets.selection import Row
from cellwatt.outlets.together import until_one_ends

MODULE: Final = "cellwatt.outlets.historian.exporting"
LONGEST, NICENESS = 86400.0, 5
"""s that a run may take, the first of all the record; and its priority."""
PAUSE: Final = 30.0
"""s until the next try after one that failed, at most."""


class Lake:
    """Runs the process every some time; counts what it tells in ``account``."""

    def __init__(self, settings: LakeSettings, told: dict[str, Any], account: Account) -> None:
        self._settings, self._account = settings, account
        self._told = {**told, "settings": revealed(settings)}
        self.problem: str | None = None
        """Reason why the last run failed; ``None`` if it did not."""

    async def run(self) -> None:
        """Export until cancelled. Raises ``OutletError`` where that can never be."""
        if find_spec("pyarrow") is None:
            raise OutletError("lake: pyarrow is missing: pip install pyarrow")
        while True:
            self.problem = await self.once()
            if self.problem is not None:
                self._account.count("lake: runs failed")
            await asyncio.sleep(self._settings.every if self.problem is None else min(PAUSE, self._settings.every))

    async def once(self) -> str | None:
        """Export what is new; return the reason where that failed."""
        try:
            await output([MODULE], LONGEST, NICENESS, given=json.dumps(self._told).encode(), heard=self._heard)
        except CellwattError as error:
            return f"lake: {str(error).removeprefix('lake: ')}"
        return None

    def _heard(self, line: str) -> None:
        """Count a file that the process tells of."""
        with contextlib.suppress(ValueError, TypeError, KeyError):  # its last words
            said = json.loads(line)
            rows, lost, table = said["rows"], said["lost"], said["table"]
            self._account.expect(rows + lost)
            self._account.receive(rows)
            self._account.miss(lost, "lake: no longer in the record")
            if rows or not lost:
                what = f"files of {table}" if rows else "sessions without any of its channels"
                self._account.count(f"lake: {what}")


if find_spec("aiohttp") is None:  # a lake alone does without it, but what is missing is told at once
    raise ModuleNotFoundError("No module named 'aiohttp'", name="aiohttp")

log = logging.getLogger(__name__)

FILE: Final = "historian-influx.json"
REFUSED: Final = "historian-refused.txt"
"""File of the lines that the server will never take, with the reasons."""
LARGEST: Final = 16_000_000
"""Bytes of it."""
TRIES: Final = 64
"""Requests by which the bad lines of a batch are looked for; then what is left of it is refused as a whole."""


class Lines(Peer[str]):
    """Lines of one database or bucket; those that it refuses are kept in ``folder``."""

    def __init__(self, client: Client, measurement: str, tags: Mapping[str, str], folder: Path | None) -> None:
        self._client, self._folder = client, folder
        self._measurement, self._tags = measurement, tags

    def row(self, row: Row, units: Mapping[str, str]) -> str | None:
        """See ``Peer.row``."""
        return row_line(self._measurement, self._tags, row) or None

    def result(self, result: Archived) -> str | None:
        """See ``Peer.result``."""
        return result_line(self._measurement, self._tags, result) or None

    async def send(self, messages: Sequence[str]) -> Mapping[str, int]:
        """See ``Peer.send``; where the server refuses some lines, those are found by halves.

        A batch with a bad line is sent again in parts: a point that was written already is the same point.
        """
        parts, found = [list(messages)], Counter[str]()
        tries = 0
        while parts:
            part = parts.pop()
            outcome = await self._client.write(part)
            tries += 1
            match outcome.kind:
                case "written":
                    continue
                case "later":
                    raise NotNowError(f"{self._client.url}: {outcome.reason}", outcome.wait)
                case "refused" | "too large" if len(part) > 1 and tries < TRIES:
                    half = len(part) // 2
                    parts += [part[half:], part[:half]]
                case _:
                    await asyncio.to_thread(_refused, self._folder, part, outcome.reason)
                    found[outcome.kind] += len(part)
        return found


def _refused(folder: Path | None, lines: Sequence[str], reason: str) -> None:
    """Put lines aside, below the reason; without a folder the log alone tells. Blocks."""
    log.warning("influx: %d lines are refused for good: %s", len(lines), reason)
    if folder is not None:
        content = "\n".join((f"# {' '.join(reason.split())}", *lines, "")).encode()
        try:
            put_aside(folder / REFUSED, content, LARGEST, 0o644)
        except OSError as error:
            log.warning("influx: %s cannot be written: %s", folder / REFUSED, why(error))


class HistorianOutlet(Outlet[HistorianSettings]):
    """Writes rows and results to InfluxDB as they come, and brings the record into the lake."""

    Settings: ClassVar[type[HistorianSettings]] = HistorianSettings
    title = "History in InfluxDB, and in a lake of Parquet files (a folder or S3)"

    def __init__(self, name: str, settings: HistorianSettings, view: CellView) -> None:
        super().__init__(name, settings, view)
        self._record = framed_record(view)
        influx = settings.influx
        self._influx: Forwarder[str] | None = None
        if influx is not None:
            self._client = Client(influx)
            place = f"{influx.url} {influx.database or influx.bucket} {influx.org or ''}".strip()
            cursor = Cursor(None if self._record is None else self._record / FILE, self.account, place)
            peer = Lines(self._client, influx.measurement, {"site": view.site, "cell": view.cell}, self._record)
            self._influx = Forwarder("influx", peer, influx, view.cell, self._record, cursor, self.account)
        self._lake: Lake | None = None
        if settings.lake is not None and self._record is not None:
            told = {"record": str(self._record), "folder": str(view.folder), "site": view.site, "cell": view.cell}
            self._lake = Lake(settings.lake, told, self.account)

    def offer(self, item: Item) -> None:
        """Queue an item for InfluxDB; the lake is filled from the record."""
        if self._influx is not None:
            self._influx.offer(item)

    def health(self, status: Mapping[str, Any]) -> None:
        """Nothing of it is kept."""

    def succeed(self, before: Outlet[Any]) -> None:
        """Go on where the outlet before ended; the lake goes on by its file."""
        if isinstance(before, HistorianOutlet) and self._influx is not None and before._influx is not None:
            self._influx.succeed(before._influx)

    def trouble(self) -> str | None:
        """Reason why InfluxDB or the lake takes nothing; ``None`` if all is well."""
        said = [] if self._influx is None else list(self._influx.troubles)
        said += [] if self._lake is None else [self._lake.problem]
        return "; ".join(filter(None, said)) or None

    async def run(self) -> None:
        """Write until cancelled. Raises ``OutletError`` where there is no record to fill the lake from."""
        if self.settings.lake is not None and self._record is None:
            raise OutletError("lake: it is filled from the record: set record, with frames (record: {frames: true})")
        async with self._client if self._influx is not None else contextlib.nullcontext():
            await until_one_ends(*(part.run() for part in (self._influx, self._lake) if part is not None))
