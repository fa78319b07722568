"""Writes the history of a cell to InfluxDB and, through a process run periodically, to a lake of Parquet files."""

from __future__ import annotations

import asyncio
import contextlib
import json
import math
import time
from typing import Any, ClassVar, Final

from cellwatt.account import Account
from cellwatt.child import output
from cellwatt.errors import CellwattError, OutletError
from cellwatt.outlet import CellView, Item, Outlet, revealed
from cellwatt.outlets.cursor import Cursor
from cellwatt.outlets.forward import Forwarder, framed_record
from cellwatt.outlets.historian.client import Influx
from cellwatt.outlets.historian.settings import HistorianSettings, LakeSettings
from cellwatt.together import until_one_ends

MODULE: Final = "cellwatt.outlets.historian.exporting"
LONGEST, NICENESS = 86400.0, 5
"""Longest time, s, of a run (the first exports the whole record), and its niceness."""
SILENT: Final = 600.0
"""Time, s, after which a run that reports no file seems to hang: its folder is on a share that does not respond."""
PAUSE: Final = 30.0
"""Longest pause, s, after a failed run."""


class Lake:
    """Runs the process periodically; counts the rows and files that it reports in ``account``."""

    def __init__(self, settings: LakeSettings, order: dict[str, Any], account: Account) -> None:
        self._settings, self._account = settings, account
        self._order = {**order, "settings": revealed(settings)}
        self.problem: str | None = None
        """Reason why the last run failed, or ``None``."""
        self._heard_at = math.inf
        """Monotonic s at which the present run began or reported a file; infinite between two runs."""

    async def run(self) -> None:
        """Export until cancelled."""
        while True:
            self._heard_at = time.monotonic()
            try:
                await output([MODULE], LONGEST, NICENESS, given=json.dumps(self._order).encode(), heard=self._heard)
                self.problem = None
            except CellwattError as error:
                self.problem = f"lake: {str(error).removeprefix('lake: ')}"
                self._account.count("lake: runs failed")
            self._heard_at = math.inf
            await asyncio.sleep(self._settings.every if self.problem is None else min(PAUSE, self._settings.every))

    def trouble(self) -> str | None:
        """Reason why the last run failed, or that the present one seems to hang; else ``None``."""
        hangs = time.monotonic() - self._heard_at > SILENT
        return f"lake: no file was written for {SILENT / 60:.0f} min" if hangs else self.problem

    def _heard(self, line: str) -> None:
        """Count a file that the process reports."""
        self._heard_at = time.monotonic()
        with contextlib.suppress(ValueError, TypeError, KeyError):  # the error message at its end
            report = json.loads(line)
            rows, lost, table = report["rows"], report["lost"], report["table"]
            self._account.expect(rows + lost)
            self._account.receive(rows)
            self._account.miss(lost, "lake: no longer in the record")
            if rows or not lost:
                what = f"files of {table}" if rows else "stretches without any of its channels"
                self._account.count(f"lake: {what}")


FILE: Final = "historian-influx.json"


class HistorianOutlet(Outlet[HistorianSettings]):
    """Writes new rows and results to InfluxDB, and exports the record to the lake."""

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
            order = {"record": str(self._record), "folder": str(view.folder), "site": view.site, "cell": view.cell}
            self._lake = Lake(settings.lake, order, self.account)

    def offer(self, item: Item) -> None:
        """Queue an item for InfluxDB; the lake reads from the record."""
        if self._influx is not None:
            self._influx.offer(item)

    def succeed(self, before: Outlet[Any]) -> None:
        """Continue from the position of the previous outlet; the lake continues from its file."""
        if isinstance(before, HistorianOutlet) and self._influx is not None and before._influx is not None:
            self._influx.succeed(before._influx)

    def trouble(self) -> str | None:
        """Reason why InfluxDB or the lake accepts nothing, or ``None``."""
        troubles = [] if self._influx is None else list(self._influx.troubles)
        troubles += [] if self._lake is None else [self._lake.trouble()]
        return "; ".join(filter(None, troubles)) or None

    async def run(self) -> None:
        """Write until cancelled. Raises ``OutletError`` if the lake has no record to read from."""
        if self.settings.lake is not None and self._record is None:
            raise OutletError("lake: it is read from the record: set record, with frames (record: {frames: true})")
        async with self._peer if self._influx is not None else contextlib.nullcontext():
            await until_one_ends(*(part.run() for part in (self._influx, self._lake) if part is not None))
