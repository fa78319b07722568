"""The lake: what is in it is what was recorded, each row once, wherever its writer is killed."""

from __future__ import annotations

import fcntl
import json
import os
import subprocess
import sys
import tracemalloc
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from cellwatt import FrameChannel, Layout, OutletError
from cellwatt.outlets import past
from cellwatt.outlets.historian import exporting, pieces
from cellwatt.outlets.historian.exporting import FILE, LOCK, Export, Progress
from cellwatt.outlets.historian.outlet import MODULE
from cellwatt.outlets.historian.settings import LakeSettings
from cellwatt.outlets.historian.store import Store
from cellwatt.outlets.past import opened
from cellwatt.outlets.selection import Picker
from cellwatt.record import overlap
from cellwatt.record.survey import Survey, survey
from cellwatt.units import Units
from tests.blocks import frames_of, marked
from tests.daemon.outlets.historian.made import ANOTHER, CELL, DAY, SESSION, SITE, START, Recorded, S, row_truth
from tests.patience import PATIENCE

RESULTS = ("alarms", "tasks", "energies")


@pytest.fixture
def lake(tmp_path: Path) -> Path:
    return tmp_path / "lake"


def export(record: Path, lake: Path, store: Any = None, **settings: Any) -> list[exporting.Done]:
    made = LakeSettings(folder=str(lake), **settings)
    return list(Export(record, SITE, CELL, made, store or Store(lake)).run())


def table_of(lake: Path, table: str = "frames") -> list[dict[str, Any]]:
    """All rows of a table as they stand in its files, in the order of their times."""
    rows = [
        row for path in sorted(lake.glob(f"{table}/**/*.parquet")) for row in pq.ParquetFile(path).read().to_pylist()
    ]
    return sorted(rows, key=lambda row: row["time"].value)


def sequences(lake: Path, session: int) -> list[int]:
    return [row["sequence"] for row in table_of(lake) if row["session"] == session]


def check(lake: Path, seconds: Sequence[int], session: int = SESSION) -> None:
    rows = [row | {"time": row["time"].value} for row in table_of(lake) if row["session"] == session]
    found = [{name: row[name] for name in row_truth(0)} for row in rows]
    assert len(found) == len(seconds)
    for row, second in zip(found, seconds, strict=True):
        truth = row_truth(second, session)
        assert {name for name, value in row.items() if value is None} == {n for n, v in truth.items() if v is None}
        there = {name: value for name, value in truth.items() if value is not None}
        assert {name: row[name] for name in there} == pytest.approx(there, rel=1e-12, abs=0)


def check_results(lake: Path, seconds: range) -> None:
    expected = [s for s in seconds if s % 5 == 2]
    assert [row["joint"] for row in table_of(lake, "alarms")] == expected
    for table in ("tasks", "energies"):
        assert [row["repetition"] for row in table_of(lake, table)] == expected


def test_rows_are_those_of_the_record(record: Path, lake: Path) -> None:
    Recorded(record).seconds(23).rotate().seconds(7).close()
    done = export(record, lake)
    check(lake, range(30))
    check_results(lake, range(30))
    assert {(d.table, d.rows, d.lost) for d in done if d.table == "frames"} == {("frames", 30, 0)}
    assert sum(d.rows for d in done) == 30 + 3 * 6
    (path,) = lake.glob("frames/**/*.parquet")
    assert str(path.relative_to(lake)) == f"frames/site=plant-1/cell=weld-3/day=2026-11-21/{SESSION}_0_1499.parquet"
    schema = pq.read_schema(path)
    assert schema.field("time").type.tz == "UTC"
    assert schema.field("arm.bus.power").metadata[b"unit"] == b"W"
    assert json.loads(schema.metadata[b"cellwatt"])["cell"] == CELL
    qualities = [row["quality"] for row in table_of(lake)]
    assert qualities == [0] * 30
    assert export(record, lake) == []


def test_results_tell_what_they_told(record: Path, lake: Path) -> None:
    Recorded(record).seconds(5).close()
    export(record, lake)
    (alarm,), (task,), (energy,) = (table_of(lake, table) for table in RESULTS)
    at = SESSION + 2 * S + S // 2
    assert (alarm["time"].value, alarm["id"], alarm["active"], alarm["joint"]) == (at, "a2", True, 2)
    assert json.loads(alarm["evidence"]) == {"residual_W": "NaN", "n": 2}  # as the record has it
    assert (task["task"], task["start"].value, task["speed"]) == ("task_1", at - 7 * S, 1.0)
    assert (energy["total"], dict(energy["groups"])) == (102.0, {"mechanical_losses": 62.0, "electronics": 40.0})


def test_the_rows_of_the_largest_file_take_little_memory() -> None:
    """The process shares the memory that the service is allowed, and the first run writes a file of this size."""
    channels = (FrameChannel(f"arm.joint_{n}.position", "rad", "continuous", "linear") for n in range(60))
    layout, settings = Layout(tuple(channels), 50.0), LakeSettings(folder="lake", rate=50.0)
    values = np.random.default_rng(0).standard_normal((500, 60))
    given = frames_of(layout, 0, START + np.arange(500) * layout.step, values, marked(values))

    def table() -> Any:
        picker = Picker(settings, layout)
        return pieces.frame_table(list(picker.rows(given)), picker.units, SESSION)

    table()  # imports what it needs
    tracemalloc.start()
    made = table()
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak / made.num_rows / made.num_columns * pieces.VALUES < 150e6


def test_a_run_ends_though_the_record_grows(record: Path, lake: Path) -> None:
    growing = Recorded(record).seconds(3)

    class Slow(Store):
        def put(self, path: str, content: bytes) -> None:
            super().put(path, content)
            growing.seconds(1, results=False)

    done = export(record, lake, Slow(lake), results=False)
    assert [d.rows for d in done] == [3]
    growing.close()
    export(record, lake, results=False)
    check(lake, range(4))


def test_what_is_exported_of_a_running_session_is_not_opened_again(
    record: Path, lake: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A session may last for months: hundreds of files, and tables that none of them has a result for."""
    looked: list[str] = []

    def noted(path: Path, **how: bool) -> Survey:
        looked.append(path.name)
        return survey(path, **how)

    for module in (past, overlap):
        monkeypatch.setattr(module, "survey", noted)
    growing = Recorded(record)
    for seconds in range(3, 15, 3):
        growing.seconds(3, results=seconds == 6).rotate()
        for table in export(record, lake):
            assert table.lost == 0
    growing.seconds(3, results=False)
    for _ in range(2):
        overlap._reach.cache_clear()  # each run is a process of its own
        looked.clear()
        export(record, lake)
    assert {name.rpartition("_")[2] for name in looked} == {"000005.mcap.part"} and len(looked) <= 5
    growing.seconds(3, results=True).close()
    export(record, lake)
    check(lake, range(18))
    assert [row["joint"] for row in table_of(lake, "alarms")] == [17]


def test_a_file_of_a_running_session_that_cannot_be_opened_now_is_exported_later(record: Path, lake: Path) -> None:
    growing = Recorded(record).seconds(3).rotate()
    growing.seconds(3, results=False)
    (closed,) = record.glob("*.mcap")
    away = closed.rename(record / "away")
    closed.write_bytes(b"")
    export(record, lake)
    away.rename(closed)
    export(record, lake)
    growing.close()
    check_results(lake, range(3))


@pytest.mark.parametrize("dated_back", [True, False])
def test_a_session_whose_clock_was_set_back_is_exported_too(record: Path, lake: Path, dated_back: bool) -> None:
    """A PC with an empty battery starts again with a time of years ago.

    The old session is not the last by its name; its last row, of half a second, is complete all the same.
    """
    earlier = SESSION - 10_000 * S + S // 2
    old = Recorded(record, SESSION + S // 2).seconds(3)
    (old.rotate if dated_back else old.close)()
    export(record, lake)
    assert sequences(lake, SESSION + S // 2) == [24, 74, 124], "its last row may not be complete yet"
    growing = Recorded(record, earlier)
    for seconds in (3, 5):
        growing.seconds(seconds)
        for path in record.glob("*.part") if dated_back else ():
            os.utime(path, (1e9, 1e9))
        export(record, lake)
    growing.close()
    assert sequences(lake, SESSION + S // 2) == [24, 74, 124, 149]
    assert sequences(lake, earlier) == [24 + 50 * n for n in range(8)]
    assert [row["repetition"] for row in table_of(lake, "tasks")] == [2, 7, 2]
    assert export(record, lake) == []


def test_positions_of_sessions_without_a_file_are_forgotten(
    record: Path, lake: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(exporting, "SESSIONS", 2)
    for number in range(4, 0, -1):  # the clock is set back before each
        if number == 2:
            min(record.glob("*.mcap"), key=lambda path: path.stat().st_mtime_ns).unlink()
        Recorded(record, SESSION + number * 1000 * S).seconds(2).rotate()
        assert sum(done.rows for done in export(record, lake, results=False)) == 2
    positions = json.loads((record / FILE).read_text())["reached"]["frames"]
    assert [*map(int, positions)] == [SESSION + number * 1000 * S for number in (3, 2, 1)]


def test_files_of_ended_sessions_are_read_once(record: Path, lake: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for number in range(3):
        Recorded(record, SESSION + number * 1000 * S).seconds(2, results=number == 1).rotate().seconds(2).rotate()
        export(record, lake)
    read: list[Path] = []
    monkeypatch.setattr(pieces, "opened", lambda path: read.append(path) or opened(path))
    assert export(record, lake) == []
    assert set(read) == {max(record.glob("*.mcap"))}


def test_a_file_holds_one_day(record: Path, lake: Path) -> None:
    session = START + DAY - 5 * S
    Recorded(record, session).seconds(10, results=False).close()
    export(record, lake)
    days = {path.parent.name: pq.ParquetFile(path).metadata.num_rows for path in lake.glob("frames/**/*.parquet")}
    # The row of the second that ends at midnight stands at midnight.
    assert days == {"day=2026-11-21": 4, "day=2026-11-22": 6}
    check(lake, range(10), session)


def test_other_channels_begin_a_new_file(record: Path, lake: Path) -> None:
    Recorded(record).seconds(5).rotate()
    Recorded(record, layout=ANOTHER, second=5).seconds(5).close()
    export(record, lake)
    check(lake, range(10))
    columns = [set(pq.read_schema(path).names) for path in sorted(lake.glob("frames/**/*.parquet"))]
    assert [("mains.supply.power" in names) for names in columns] == [False, True]


def test_units_and_channels_are_chosen(record: Path, lake: Path) -> None:
    Recorded(record).seconds(2).close()
    export(record, lake, channels=("*.power",), units=Units(power="kW"), rate=0.5, results=False)
    (row,) = table_of(lake)
    assert set(row) == {"time", "session", "sequence", "quality", "arm.bus.power"}
    assert row["arm.bus.power"] == pytest.approx((100 + 49.5) / 1000)
    assert not list(lake.glob("alarms/**/*.parquet"))


def test_channels_that_there_are_not_do_not_hold_up_the_next_session(record: Path, lake: Path) -> None:
    Recorded(record).seconds(2).rotate()
    Recorded(record, SESSION + 60 * S, layout=ANOTHER).seconds(2).close()
    done = export(record, lake, channels=("mains.*",))
    assert [(d.rows, d.lost) for d in done if d.table == "frames"] == [(0, 0), (2, 0)]
    assert [row["session"] for row in table_of(lake)] == [SESSION + 60 * S] * 2


def test_a_running_session_without_the_channels_is_read_once(
    record: Path, lake: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    growing = Recorded(record).seconds(2).rotate().seconds(2)
    export(record, lake, channels=("mains.*",))
    growing.seconds(1, results=False)
    read: list[int] = []
    monkeypatch.setattr(Picker, "rows", lambda _, frames: read.append(frames.sequence) or ())
    export(record, lake, channels=("mains.*",))
    assert read == [200]
    growing.close()


def test_frames_that_the_record_has_no_more_are_counted(record: Path, lake: Path) -> None:
    growing = Recorded(record).seconds(4)
    export(record, lake)
    growing.rotate().seconds(3).rotate().seconds(3).close()
    (record / sorted(p.name for p in record.glob("*.mcap"))[1]).unlink()
    done = export(record, lake)
    assert [(d.rows, d.lost) for d in done if d.table == "frames"] == [(3, 150)]
    check(lake, [*range(4), *range(7, 10)])


class Killed(BaseException):
    """The process is gone at once."""


class Doomed(Store):
    """A lake whose writer is killed at its n-th step: before or after a file is there, or in the middle of it."""

    def __init__(self, folder: Path, steps: int) -> None:
        super().__init__(folder)
        self.root, self.left = folder, steps

    def step(self) -> None:
        self.left -= 1
        if self.left < 0:
            raise Killed

    def put(self, path: str, content: bytes) -> None:
        self.step()
        target = self.root / path
        target.parent.mkdir(parents=True, exist_ok=True)
        target.with_name(f".{target.name}.part").write_bytes(content[: len(content) // 2])
        self.step()
        super().put(path, content)
        self.step()


@pytest.fixture
def saves(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Doomed]]:
    """Stores whose writer may also be killed before and after its positions are on disk."""
    doomed: list[Doomed] = []
    real = Progress.save

    def save(progress: Progress, folder: Path) -> None:
        for store in doomed:
            store.step()
        real(progress, folder)
        for store in doomed:
            store.step()

    monkeypatch.setattr(Progress, "save", save)
    yield doomed


def test_killed_at_any_step_each_row_is_there_once(record: Path, lake: Path, saves: list[Doomed]) -> None:
    """The n-th run is killed at its n-th step, while the record grows over midnight; then one that is not."""
    session = START + DAY - 20 * S
    growing = Recorded(record, session)
    runs = killed = 0
    while growing.second < 45:
        growing.seconds(1)
        store = Doomed(lake, steps=runs % 37)
        saves[:] = [store]
        try:
            export(record, lake, store)
        except Killed:
            killed += 1
        runs += 1
        if growing.second % 13 == 0:
            growing.rotate()
    saves.clear()
    export(record, lake)
    growing.close()
    assert killed > 20
    check(lake, range(45), session)
    check_results(lake, range(45))


def test_a_lost_file_of_positions_does_no_harm(record: Path, lake: Path) -> None:
    growing = Recorded(record).seconds(8)
    export(record, lake)
    (record / FILE).unlink()
    growing.seconds(4)
    export(record, lake)
    (record / FILE).write_text("{")
    growing.rotate().seconds(4)
    export(record, lake)
    (record / FILE).unlink()
    os.mkfifo(record / FILE)  # which cannot be read
    growing.rotate().seconds(4).close()
    export(record, lake)
    check(lake, range(20))
    check_results(lake, range(20))


def test_another_lake_begins_anew(record: Path, lake: Path, tmp_path: Path) -> None:
    Recorded(record).seconds(5).close()
    export(record, lake)
    export(record, tmp_path / "other")
    check(tmp_path / "other", range(5))


def test_a_file_begun_whose_frames_are_gone_is_given_up_and_counted(
    record: Path, lake: Path, saves: list[Doomed]
) -> None:
    growing = Recorded(record).seconds(2)
    export(record, lake, results=False)
    growing.seconds(2).rotate()
    saves[:] = [store := Doomed(lake, steps=2)]  # that a file is begun is on disk, the file is not
    with pytest.raises(Killed):
        export(record, lake, store, results=False)
    saves.clear()
    for path in record.glob("*.mcap"):
        path.unlink()
    growing.seconds(4).close()
    done = export(record, lake, results=False)
    check(lake, [0, 1, *range(4, 8)])
    assert sum(d.lost for d in done) == 100


def test_a_lake_that_cannot_be_written_is_told(record: Path, lake: Path) -> None:
    Recorded(record).seconds(2).close()
    lake.write_text("no folder")
    with pytest.raises(OutletError, match=r"lake: .*: (Not a directory|File exists)"):
        export(record, lake)
    lake.unlink()
    export(record, lake)
    check(lake, range(2))


def test_two_processes_do_not_write_one_lake(record: Path, lake: Path) -> None:
    told = {"record": str(record), "folder": "/", "site": SITE, "cell": CELL, "settings": {"folder": str(lake)}}
    Recorded(record).seconds(2).close()

    def run() -> subprocess.CompletedProcess[str]:
        command = [sys.executable, "-m", MODULE]
        return subprocess.run(
            command, input=json.dumps(told), text=True, capture_output=True, timeout=PATIENCE, check=False
        )

    with (record / LOCK).open("ab") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        refused = run()
    assert refused.returncode == 1 and "another process still writes it" in refused.stderr
    assert not lake.exists()
    assert run().returncode == 0
    check(lake, range(2))
