"""The outlet and the process that writes its lake, into a folder and into S3."""

from __future__ import annotations

import asyncio
import io
import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pyarrow.parquet as pq
import pytest

from cellwatt import OutletError
from cellwatt.outlets.historian import HistorianSettings
from cellwatt.outlets.historian import outlet as outlet_module
from cellwatt.outlets.historian.exporting import FILE, work
from cellwatt.outlets.historian.outlet import MODULE, HistorianOutlet
from tests.daemon.outlets.historian.bucket import Bucket
from tests.daemon.outlets.historian.made import CELL, DAY, SITE, START, Recorded, S
from tests.daemon.outlets.historian.test_influx import running
from tests.daemon.outlets.historian.test_lake import check, check_results
from tests.daemon.outlets.serving import children
from tests.daemon.outlets.zenoh.fake_cell import FakeView
from tests.doing import doing
from tests.patience import eventually


def outlet_of(record: Path | None, folder: str, **settings: Any) -> HistorianOutlet:
    lake = {"folder": folder, "every": 0.1, **settings}
    view = FakeView(record_folder=record)
    view.folder = Path("/") if record is None else record.parent  # from where relative folders count
    return HistorianOutlet("historian", HistorianSettings.model_validate({"lake": lake}), view)


async def test_the_record_flows_into_the_lake(record: Path, tmp_path: Path) -> None:
    growing = Recorded(record)
    await asyncio.to_thread(growing.seconds, 10)
    async with running(outlet_of(record, "lake")) as outlet:
        await eventually(lambda: outlet.account.received == 10 + 3 * 2, "the first rows")
        await asyncio.to_thread(growing.seconds, 5)
        await eventually(lambda: outlet.account.received == 15 + 3 * 3, "the next rows")
        assert outlet.trouble() is None
        assert outlet.account.residue == 0
    growing.close()
    check(tmp_path / "lake", range(15))
    check_results(tmp_path / "lake", range(15))
    assert outlet.account.counters["lake: files of frames"] == 2


async def test_a_process_that_is_killed_is_told_and_begun_again(record: Path, tmp_path: Path) -> None:
    growing = Recorded(record)
    await asyncio.to_thread(growing.seconds, 5)
    async with running(outlet_of(record, "lake")) as outlet:
        (child,) = await eventually(lambda: children(MODULE), "the process")
        child.kill()
        await eventually(lambda: outlet.account.counters["lake: runs failed"], "the failure")
        await eventually(lambda: outlet.account.received == 5 + 3, "the rows")
        await eventually(lambda: outlet.trouble() is None, "the end of the trouble")
    growing.close()
    check(tmp_path / "lake", range(5))


async def test_a_run_that_hangs_is_told_before_it_ends(record: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its folder is on a share that does not respond."""
    heard: list[Callable[[str], None]] = []
    end = asyncio.Event()

    async def hangs(*_: object, **given: Any) -> None:
        heard.append(given["heard"])
        await end.wait()

    monkeypatch.setattr(outlet_module, "output", hangs)
    clock = 0.0
    monkeypatch.setattr(outlet_module, "time", SimpleNamespace(monotonic=lambda: clock), raising=False)
    outlet = outlet_of(record, "lake", every=1.0)
    assert outlet._lake is not None
    clock = 1e6
    assert outlet.trouble() is None, "no run is under way"
    async with doing(outlet._lake.run()):
        await eventually(lambda: heard, "the run")
        clock += 601.0
        assert outlet.trouble() == "lake: no file was written for 10 min"
        heard[0]('{"table": "frames", "rows": 5, "lost": 0}')
        assert outlet.trouble() is None
        clock += 599.0
        assert outlet.trouble() is None
        clock += 2.0
        assert outlet.trouble() is not None
        end.set()
        await eventually(lambda: outlet.trouble() is None, "the end of the run")


async def test_without_a_record_there_is_no_lake(tmp_path: Path) -> None:
    with pytest.raises(OutletError, match="lake: it is read from the record"):
        await outlet_of(None, str(tmp_path)).run()


KEYS = {"access_key": "AKID", "secret_key": "s3cret", "region": "eu-central-1"}


async def test_files_in_s3_are_found_by_their_names(record: Path) -> None:
    growing = Recorded(record, START + DAY - 5 * S)
    async with Bucket().open() as store:
        lake = {"folder": "s3://lake/plant", "endpoint": store.url, "results": False, **KEYS}
        told = {"record": str(record), "folder": "/", "site": SITE, "cell": CELL, "settings": lake}
        for run in range(3):
            await asyncio.to_thread(growing.seconds, 2)
            await asyncio.to_thread(work, told)
            if run == 0:
                await asyncio.to_thread((record / FILE).unlink)
    growing.close()
    written = [content for key, content in store.objects.items() if "frames" in key and key.endswith(".parquet")]
    tables = [pq.ParquetFile(io.BytesIO(content)).read() for content in written]
    times = sorted(time.value for table in tables for time in table["time"].to_pylist())
    assert times == [START + DAY - 5 * S + (second + 1) * S for second in range(6)]


async def test_secrets_go_to_the_process_alone(record: Path) -> None:
    outlet = outlet_of(record, "s3://lake/plant", endpoint="https://minio.example", **KEYS)
    assert outlet._lake is not None
    assert "s3cret" in json.dumps(outlet._lake._order)
    assert "s3cret" not in repr(outlet.settings)
