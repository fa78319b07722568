"""Keeps the history of a cell elsewhere: in InfluxDB, and in a lake of Parquet files."""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any, ClassVar

from cellwatt.errors import OutletError
from cellwatt.outlet import CellView, Item, Outlet
from cellwatt.outlets.forward import framed_record
from cellwatt.outlets.historian.influx import Influx
from cellwatt.outlets.historian.lake import Lake
from cellwatt.outlets.historian.settings import HistorianSettings
from cellwatt.outlets.together import until_one_ends

if find_spec("aiohttp") is None:  # a lake alone does without it, but what is missing is told at once
    raise ModuleNotFoundError("No module named 'aiohttp'", name="aiohttp")


class HistorianOutlet(Outlet[HistorianSettings]):
    """Writes rows and results to InfluxDB as they come, and brings the record into the lake."""

    Settings: ClassVar[type[HistorianSettings]] = HistorianSettings
    title = "History in InfluxDB, and in a lake of Parquet files (a folder or S3)"

    def __init__(self, name: str, settings: HistorianSettings, view: CellView) -> None:
        super().__init__(name, settings, view)
        self._record = framed_record(view)
        influx = settings.influx
        self._influx = None if influx is None else Influx(influx, view, self._record, self.account)
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

    def trouble(self) -> str | None:
        """Reason why InfluxDB or the lake takes nothing; ``None`` if all is well."""
        said = [] if self._influx is None else list(self._influx.forwarder.troubles)
        said += [] if self._lake is None else [self._lake.problem]
        return "; ".join(filter(None, said)) or None

    async def run(self) -> None:
        """Write until cancelled. Raises ``OutletError`` where there is no record to fill the lake from."""
        if self.settings.lake is not None and self._record is None:
            raise OutletError("lake: it is filled from the record: set record, with frames (record: {frames: true})")
        await until_one_ends(*(part.run() for part in (self._influx, self._lake) if part is not None))
