"""A disk that is full, read-only or broken."""

import asyncio
import errno
import os
import shutil
import time
from concurrent.futures import wait
from dataclasses import replace
from io import FileIO
from pathlib import Path
from stat import S_ISDIR
from unittest.mock import Mock

import pytest

from cellwatt.record import Recording, RecordSettings, openfile, recover
from cellwatt.record import files as files_module
from cellwatt.record.header import PART, FileName
from cellwatt.record.openfile import OpenFile
from cellwatt.record.upkeep import MOST_REPORTED, Upkeep
from tests.patience import PATIENCE, eventually

from .making import HEADER, SESSION, batch_of, name_of, started, write_chunks


class Disk:
    """Takes ``room`` bytes in all, then raises ``code``; a write that does not fit is cut, as real ones are."""

    def __init__(self, room, code=errno.ENOSPC):
        self.room, self.code = room, code

    def open(self, path):
        disk = self

        class File(FileIO):
            def write(self, data):
                if disk.room <= 0:
                    raise OSError(disk.code, os.strerror(disk.code))
                n = super().write(memoryview(data)[: disk.room])
                disk.room -= n
                return n

        return File(path, "xb+")


@pytest.fixture(autouse=True)
def soon(monkeypatch):
    monkeypatch.setattr(files_module, "RETRY", 0.02)


async def record(recorder, numbers):
    for n in numbers:
        assert recorder.put(batch_of(n * 10, 10))
        await asyncio.to_thread(recorder.flush, 0.2)


@pytest.mark.parametrize(
    ("code", "state", "room"),
    [
        (errno.ENOSPC, "disk full", 5),
        (errno.EDQUOT, "disk full", 9500),
        (errno.EROFS, "read-only", 0),
        (errno.EIO, "disk error", 13001),
    ],
)
async def test_nothing_is_lost_while_memory_lasts(tmp_path, monkeypatch, code, state, room):
    disk = Disk(room, code)
    monkeypatch.setattr(openfile, "create", disk.open)
    async with started(RecordSettings(folder=tmp_path)) as recorder:
        await record(recorder, range(3))
        assert all(recorder.put(batch_of(n * 10, 10)) for n in range(3, 20))
        await eventually(lambda: recorder.stats()["state"] == state)
        assert str(tmp_path) in recorder.stats()["problem"]
        disk.room = 10**9
        await eventually(lambda: recorder.stats()["state"] == "ok")
    assert recorder.stats()["drops"] == {}
    for part in tmp_path.glob(f"*{PART}"):
        assert recover(part).problem == ""
    recording = Recording.open(tmp_path)
    assert recording.batches("arm", "rtde").sequence.tolist() == list(range(200))
    assert not recording.damage


async def test_the_oldest_recording_goes_to_make_room_and_that_it_went_before_its_time_is_told(tmp_path, monkeypatch):
    old = replace(HEADER, session=SESSION - 10**12)
    for number in (1, 2, 3):
        write_chunks(tmp_path, [[batch_of(0, 50)]], number=number)
    for path in list(tmp_path.iterdir()):
        path.rename(tmp_path / path.name.replace(name_of(1)[:23], str(FileName(old.session, 1, old.cell))[:23]))
    oldest, second, third = sorted(tmp_path.iterdir())
    disk = Disk(0)
    unlink = Path.unlink

    def freeing(path, missing_ok=False):
        if path.suffix == ".mcap" and path.exists():
            disk.room += path.stat().st_size
        unlink(path, missing_ok=missing_ok)

    monkeypatch.setattr(Path, "unlink", freeing)
    monkeypatch.setattr(openfile, "create", disk.open)
    async with started(RecordSettings(folder=tmp_path)) as recorder:
        await record(recorder, range(3))
        assert recorder.stats()["state"] == "ok"
        assert not oldest.exists() and third.exists()
        short = recorder.stats()["short"]
        assert recorder.stats()["removed"]["files"] == short["files"] == (1 if second.exists() else 2)
        assert short["keep"] == recorder.settings.keep > short["bytes"] > 0
        disk.room = 10**9


async def test_recordings_are_not_given_for_nothing(tmp_path, monkeypatch):
    for number in range(1, 21):
        write_chunks(tmp_path, [[batch_of(0, 5)]], number=number)
    monkeypatch.setattr(openfile, "create", Disk(0).open)
    async with started(RecordSettings(folder=tmp_path), replace(HEADER, session=SESSION + 10**12)) as recorder:
        assert recorder.put(batch_of(0, 10))
        await eventually(lambda: "other files fill it" in recorder.stats()["upkeep_problem"])
    assert len(list(tmp_path.glob("*.mcap"))) == 12


async def test_a_sync_that_fails_moves_on_to_another_file(tmp_path, monkeypatch):
    failing = [OSError(errno.EIO, os.strerror(errno.EIO))]
    fdatasync = os.fdatasync

    def sync(descriptor):
        if failing:
            raise failing.pop()
        fdatasync(descriptor)

    monkeypatch.setattr(os, "fdatasync", sync)
    async with started(RecordSettings(folder=tmp_path, sync=0.01, flush=0.01)) as recorder:
        numbers = iter(range(10_000))

        def goes_on():
            assert recorder.put(batch_of(next(numbers), 1))
            return recorder.stats()["files"] == 2 and recorder.stats()["state"] == "ok"

        await eventually(goes_on)
        sent = next(numbers)
        await eventually(lambda: len(list(tmp_path.glob("*.mcap"))) == 1)
    assert Recording.open(tmp_path).batches("arm", "rtde").sequence.tolist() == list(range(sent))
    assert "nothing lost" in recorder.stats()["recovered"][0]


def test_a_repair_waits_for_room(tmp_path, monkeypatch):
    write_chunks(tmp_path, [[batch_of(0, 5)]], close=False)
    part = tmp_path / (name_of() + PART)
    before = part.read_bytes()
    full = Mock(side_effect=OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)))
    with monkeypatch.context() as patch:
        patch.setattr("cellwatt.record.recovery.write_all", full)
        report = recover(part)
    assert "cannot be repaired now: No space left on device" in str(report)
    assert part.read_bytes() == before
    assert recover(part).messages == 5


async def test_a_file_that_cannot_be_repaired_lengthens_no_health_for_ever(tmp_path, monkeypatch):
    write_chunks(tmp_path, [[batch_of(0, 5)]], close=False)
    read_only = Mock(side_effect=OSError(errno.EROFS, os.strerror(errno.EROFS)))
    monkeypatch.setattr("cellwatt.record.recovery.write_all", read_only)
    async with started(RecordSettings(folder=tmp_path), replace(HEADER, session=SESSION + 10**12)) as recorder:
        for _ in range(30):
            await recorder.upkeep.recovered()
            recorder.upkeep.repair_left()
        await recorder.upkeep.recovered()
        found = recorder.stats()["recovered"]
    assert len(found) == MOST_REPORTED and "cannot be repaired now: Read-only file system" in found[-1]


async def test_a_file_system_that_syncs_no_folders_is_written_all_the_same(tmp_path, monkeypatch):
    def sync(descriptor, fsync=os.fsync):
        if S_ISDIR(os.fstat(descriptor).st_mode):
            raise OSError(errno.EINVAL, os.strerror(errno.EINVAL))
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", sync)
    async with started(RecordSettings(folder=tmp_path)) as recorder:
        await record(recorder, range(3))
    assert recorder.stats()["upkeep_problem"] == ""


@pytest.mark.parametrize("how", ["moved", "folder removed"])
async def test_a_file_that_is_taken_away_is_noticed_and_what_it_held_is_counted(tmp_path, how):
    folder = tmp_path / "record"
    async with started(RecordSettings(folder=folder, sync=0.02, flush=0.01)) as recorder:
        await record(recorder, range(3))
        (part,) = folder.glob(f"*{PART}")
        away = tmp_path / "away"
        if how == "moved":
            part.rename(away)
        else:
            shutil.rmtree(folder)

        async def noticed():
            await record(recorder, [7])
            return recorder.stats()["displaced"]["files"]

        await eventually(noticed)
        await record(recorder, [8, 9])
    stats = recorder.stats()
    assert stats["state"] == "ok"
    assert ("removed while" if "removed" in how else "moved away") in stats["displaced"]["reason"]
    kept = len(Recording.open(folder).batches("arm", "rtde"))
    (topic,) = stats["samples"]
    assert stats["samples"][topic] == kept
    assert stats["drops"][topic] == stats["displaced"]["messages"]
    assert stats["samples"][topic] + stats["drops"][topic] == 10 * recorder.progress()[0]
    if how == "moved":
        moved = away.rename(tmp_path / name_of())
        assert len(Recording.open(moved).batches("arm", "rtde")) == stats["drops"][topic]


def test_a_file_that_was_taken_away_costs_the_next_one_nothing(tmp_path):
    upkeep = Upkeep(RecordSettings(folder=tmp_path), HEADER.cell, SESSION, time.time_ns)
    first, second = (OpenFile(tmp_path / name_of(number), HEADER) for number in (1, 2))
    first.part.unlink()
    upkeep.sync(first)
    wait([upkeep._syncing], PATIENCE)
    with pytest.raises(openfile.DisplacedError, match="removed"):
        upkeep.sync(first)
    upkeep.sync(first)
    wait([upkeep._syncing], PATIENCE)
    assert upkeep.sync(second)
    upkeep.close()
    for file in (first, second):
        file.release()
