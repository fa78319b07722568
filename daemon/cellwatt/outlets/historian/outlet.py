"""Keeps the history of a cell elsewhere: in InfluxDB, and by a process, again and again, in a lake of Parquet files."""

from __future__ import annotations

import asyncio
import contextlib
import json
from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any, ClassVar, Final

from cellwatt.account import Account
from cellwatt.child import output
from cellwatt.errors import CellwattError, OutletError
from cellwatt.outlet import CellView, Item, Outlet, revealed
from cellwatt.outlets.cursor import Cursor
from cellwatt.outlets.forward import Forwarder, framed_record
from cellwatt.outlets.historian.client import Influx
from cellwatt.outlets.historian.settings import HistorianSettings, LakeSettings
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


FILE: Final = "historian-influx.json"


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
            self._peer = Influx(influx, {"site": view.site, "cell": view.cell}, self._record)
            place = f"{influx.url} {influx.database or influx.bucket} {influx.org or ''}".strip()
            cursor = Cursor(None if self._record is None else self._record / FILE, self.account, place)
            self._influx = Forwarder("influx", self._peer, influx, view.cell, self._record, cursor, self.account)
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
        async with self._peer if self._influx is not None else contextlib.nullcontext():
            await until_one_ends(*(part.run() for part in (self._influx, self._lake) if part is not None))
