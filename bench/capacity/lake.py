"""A lake as the historian makes it: bytes and files by rows a second, requests to S3, and scans of a week by DuckDB.

``rows``: ten minutes of frames of 60 channels at 50 Hz, a file as the historian writes it each ten minutes (at 1, 10
and 50 rows a second), and files of some hours joined as ``compact: true`` joins them. ``scan``: mean of one channel by
cell and day over a week, on this PC's disk, whose cache has the files; the files of a cell and a day are the same file
under several names. ``requests``: what the historian asks of S3 to write, read back, list and remove one file of
300 kB, as the store of the tests counts it.
"""

from __future__ import annotations

import asyncio
import os
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from capacity.figures import Figures, Numbers, repeated
from capacity.made import CELL, SESSION, SITE, S, layout, minutes, values
from cellwatt import Frames
from cellwatt.outlets.historian.exporting import Export
from cellwatt.outlets.historian.settings import LakeSettings
from cellwatt.outlets.historian.store import BucketStore, FolderStore, s3_options
from cellwatt.outlets.historian.tables import frame_table, merged, parquet
from cellwatt.outlets.selection import Picker

ROOT = Path(__file__).resolve().parents[2]
"""Of the checkout: the store that speaks S3 is among its tests."""
CHANNELS, FRAMES = 60, 50.0
RATES = (1.0, 10.0, 50.0)
EVERY = 10
"""Minutes of a file."""
FILES = 24 * 60 // EVERY
"""Files of a day."""
JOINED = {1.0: FILES, 10.0: 12, 50.0: 6}
"""Files that are joined, by rows a second: a day, and two hours and one where a day takes too much memory here."""
CELLS, DAYS = 10, 7
QUERY = """
    SELECT cell, day, avg("arm.value_7") AS mean, max("arm.value_7") AS most
    FROM read_parquet('{}/**/*.parquet', hive_partitioning = true, union_by_name = {}) GROUP BY ALL ORDER BY ALL
"""


def measure(seconds: float, repeats: int) -> Figures:
    """Figures by rows a second, and of scans; ``seconds`` are not needed."""
    del seconds
    sys.path.append(str(ROOT))
    with tempfile.TemporaryDirectory() as name:
        record = Path(name) / "record"
        record.mkdir()
        minutes(record, CHANNELS, FRAMES, EVERY)
        rows = {f"{rate:g} Hz": repeated(partial(_written, record, rate), repeats) for rate in RATES}
    return {"rows": rows, "requests": asyncio.run(_requests()), "scan": _scans(repeats)}


async def _requests() -> Figures:
    from tests.daemon.outlets.historian.bucket import bucket

    async with bucket() as there:
        store = await asyncio.to_thread(BucketStore, "s3://lake", s3_options(there.url, None, ("key", "secret"), None))
        work: Mapping[str, Callable[[], object]] = {
            "write": lambda: store.put("day=1/a.parquet", bytes(300_000)),
            "read back": lambda: store.get("day=1/a.parquet"),
            "list": lambda: store.names("day=1"),
            "remove": lambda: store.remove("day=1/a.parquet"),
        }
        found = {}
        for what, do in work.items():
            there.log.clear()
            await asyncio.to_thread(do)
            found[what] = dict(Counter("LIST" if "?" in line else line.split()[0] for line in there.log))
    return found


def _written(record: Path, rate: float) -> Numbers:
    """MB a day and cell, as files of ten minutes and joined, and processor time of the process that writes them."""
    with tempfile.TemporaryDirectory() as name:
        began = time.process_time()
        settings = LakeSettings(folder=name, rate=rate, results=False)
        done = list(Export(record, SITE, CELL, settings, FolderStore(Path(name))).run())
        used = time.process_time() - began
        (path,) = Path(name).rglob("*.parquet")
        size = path.stat().st_size
        (record / "historian-lake.json").unlink(missing_ok=True)
    files = _contents(rate, JOINED[rate])
    began = time.process_time()
    ((_, table),) = merged(files)
    joined = len(parquet(table, {}))
    joining = time.process_time() - began
    share = FILES / JOINED[rate]
    return {
        "rows": float(sum(piece.rows for piece in done)),
        "kB_a_file": size / 1e3,
        "MB_a_day": size * FILES / 1e6,
        "MB_a_day_joined": joined * share / 1e6,
        "cpu_s_a_day": used * FILES,
        "join_cpu_s_a_day": joining * share,
        "table_MB_a_day": table.nbytes * share / 1e6,
    }


def _contents(rate: float, count: int) -> list[bytes]:
    """Files of the lake of ten minutes each, one after the other."""
    n = round(60 * EVERY * rate)
    table, shape = values(n * count, CHANNELS, rate), layout(CHANNELS, rate)
    zeros = np.zeros((n, CHANNELS))
    made = []
    for first in range(0, n * count, n):
        times = SESSION + np.arange(first + 1, first + n + 1) * shape.step
        frames = Frames(shape, first, times, table[first : first + n], zeros.astype(np.uint8), zeros.astype(np.int64))
        picker = Picker(LakeSettings(folder="lake", rate=rate), shape)
        rows = [*picker.rows(frames), *picker.rest()]
        made.append(parquet(frame_table(rows, picker.units, SESSION), {"site": SITE, "cell": CELL}))
    return made


def _scans(repeats: int) -> Figures:
    """s of a scan of a week, and processor time, by whether the files of a day are joined."""
    with tempfile.TemporaryDirectory() as name:
        day = _contents(1.0, FILES)
        ((_, table),) = merged(day)
        found: Figures = {"cells": CELLS, "days": DAYS, "rows": CELLS * DAYS * table.num_rows}
        for what, contents in (("joined", [parquet(table, {})]), ("files of ten minutes", day)):
            folder = Path(name) / what.replace(" ", "_")
            _spread_out(folder, contents)
            for union in (False, True):
                key = f"{what}, union_by_name" if union else what
                found[key] = repeated(partial(_scan, folder, union), repeats)
        return found


def _spread_out(folder: Path, contents: Sequence[bytes]) -> None:
    """A lake of ``CELLS`` and ``DAYS`` of the same files."""
    first: list[Path] = []
    for cell in range(CELLS):
        for day in range(DAYS):
            place = folder / f"frames/site={SITE}/cell=cell-{cell:03}/day=2026-11-{16 + day}"
            place.mkdir(parents=True)
            for number, content in enumerate(contents):
                path = place / f"{SESSION}_{number * S}_{number}.parquet"
                if len(first) <= number:
                    path.write_bytes(content)
                    first.append(path)
                else:
                    os.link(first[number], path)


def _scan(folder: Path, union: bool) -> Numbers:
    import duckdb

    began, used = time.monotonic(), time.process_time()
    with duckdb.connect() as fresh:
        rows = fresh.sql(QUERY.format(folder, str(union).lower())).fetchall()
    assert len(rows) == CELLS * DAYS
    return {"s": time.monotonic() - began, "cpu_s": time.process_time() - used}
