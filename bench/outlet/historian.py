"""The historian: rows into InfluxDB beside plain posts, and what fills in from a record, also into a lake."""

from __future__ import annotations

import asyncio
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

from cellwatt.outlets.historian.exporting import Export
from cellwatt.outlets.historian.settings import LakeSettings
from cellwatt.outlets.historian.store import FolderStore
from cellwatt.record import Header
from cellwatt.record.encoder import Encoder
from cellwatt.record.header import FileName
from cellwatt.record.openfile import OpenFile
from outlet import influx
from outlet.figures import Figures, Numbers, repeated
from outlet.rows import CELL, RATE, SITE, START, frames
from outlet.servers import INFLUXD, influxd
from outlet.turns import in_turn

HISTORY = 600
"""s of frames in the record that is filled in from."""


def measure(seconds: float, repeats: int) -> Figures:
    """Figures of the historian: InfluxDB and a lake."""
    with tempfile.TemporaryDirectory() as name:
        folder, record = Path(name), Path(name) / "record"
        record.mkdir()
        recorded(record, HISTORY)
        found: Figures = {"lake": repeated(lambda: lake(record, folder), repeats)}
        if INFLUXD is None:
            return {**found, "influx": "not measured: influxd is not installed"}
        with influxd(folder / "influx") as url:
            ways: dict[str, Callable[[], Numbers]] = {
                "influx": partial(_run, influx.offered, url, seconds),
                "plain_posts": partial(_run, influx.posted, url, seconds),
                "filled_in": lambda: asyncio.run(influx.filled(url, record, HISTORY)),
            }
            return found | in_turn(ways, repeats)


def _run(way: influx.Way, url: str, seconds: float) -> dict[str, float]:
    return asyncio.run(way(url, seconds))


def recorded(folder: Path, seconds: int) -> None:
    """A record of so many seconds of frames, a chunk a second."""
    file = OpenFile(folder / str(FileName(START, 1, CELL)), Header(SITE, CELL, START, number=1))
    encoder = Encoder(file)
    for second in range(seconds):
        encoder.add(frames(second * round(RATE), round(RATE)))
        file.write_chunk()
    file.finish()
    file.publish()


def lake(record: Path, folder: Path) -> dict[str, float]:
    """Rows a second into Parquet at the rate of the frames, and bytes of a row."""
    with tempfile.TemporaryDirectory(dir=folder) as place:
        settings = LakeSettings(folder=place, rate=RATE, results=False)
        began = time.monotonic()
        rows = sum(done.rows for done in Export(record, SITE, CELL, settings, FolderStore(Path(place))).run())
        size = sum(path.stat().st_size for path in Path(place).rglob("*.parquet"))
        return {"rows_per_s": rows / (time.monotonic() - began), "bytes_per_row": size / rows, "rows": rows}
