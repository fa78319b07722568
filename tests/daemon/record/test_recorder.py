import asyncio
import threading
from dataclasses import replace

import numpy as np
import pytest
from blockbuster import blockbuster_ctx

from cellwatt import Alarm, Channel, Event, RecordingError, Stream, Tick
from cellwatt.record import Health, Recording, RecordSettings
from cellwatt.record import files as files_module
from cellwatt.record.header import PART
from cellwatt.record.survey import survey
from tests.patience import PATIENCE, eventually

from .making import ARM, HEADER, SESSION, batch_of, frames_of, name_of, same_entry, started, write_chunks


@pytest.fixture
async def recorder(tmp_path):
    async with started(RecordSettings(folder=tmp_path)) as recorder:
        yield recorder


async def test_items_are_written_in_order_and_counted(recorder, tmp_path):
    sent = [batch_of(0, 3), Tick(SESSION), batch_of(3, 2), Tick(SESSION + 5)]
    for item in sent:
        assert recorder.put(item)
    assert recorder.put(frames_of(0, 4))
    assert recorder.put(Event(SESSION, None, "started", "up"))
    assert recorder.put(Alarm("a", "joint_fault", "error", True, SESSION, SESSION, "x"))
    assert recorder.put(Health(SESSION, {"ok": True}))
    await recorder.close()
    recording = Recording.open(tmp_path)
    assert all(map(same_entry, recording.entries(), sent))
    stats = recorder.stats()
    assert stats["samples"] == {
        "/raw/arm/rtde": 5, "/tick": 2, "/frame": 4, "/event": 1, "/alarm": 1, "/health": 1,
    }  # fmt: skip
    assert stats["samples"] == recording.counts
    assert (stats["state"], stats["drops"], stats["queue"]) == ("ok", {}, {"items": 0, "bytes": 0})
    assert stats["bytes"] == sum(p.stat().st_size for p in tmp_path.iterdir()) - closing_size(tmp_path)


def closing_size(folder):
    """The end of a file is not counted as recorded."""
    (path,) = folder.glob("*.mcap")
    chunk = survey(path).contents.chunks[-1]
    return path.stat().st_size - (chunk.offset + chunk.length + chunk.index_length)


async def test_frames_are_left_out_on_request_and_empty_blocks_are_nothing(tmp_path):
    async with started(RecordSettings(folder=tmp_path, frames=False)) as recorder:
        assert recorder.put(frames_of(0, 4)) and recorder.put(replace(batch_of(0, 1), time=np.empty(0, np.int64)))
        assert recorder.put(batch_of(0, 1))
    assert Recording.open(tmp_path).counts == {"/raw/arm/rtde": 1}


async def test_a_full_queue_refuses_and_counts(tmp_path, monkeypatch):
    blocked = threading.Event()
    write_chunk = files_module.OpenFile.write_chunk

    def slow(file):
        assert blocked.wait(PATIENCE)
        write_chunk(file)

    monkeypatch.setattr(files_module.OpenFile, "write_chunk", slow)
    async with started(RecordSettings(folder=tmp_path, queue=100e3)) as recorder:
        taken = [recorder.put(batch_of(n * 100, 100)) for n in range(20)]
        assert taken[0] and not taken[-1]
        assert recorder.stats()["drops"] == {"/raw/arm/rtde": 100 * taken.count(False)}
        assert recorder.stats()["queue"]["bytes"] <= 100e3
        await eventually(lambda: recorder.stats()["overdue"] > 0)
        blocked.set()
        await eventually(lambda: recorder.stats()["overdue"] == 0)
    assert len(Recording.open(tmp_path).batches("arm", "rtde")) == 100 * taken.count(True)


async def test_files_rotate_by_size_alone_if_the_age_is_0(tmp_path):
    async with started(RecordSettings(folder=tmp_path, file_size=60e3, file_age=0.0, flush=0.001)) as recorder:
        for n in range(30):
            assert recorder.put(batch_of(n * 100, 100))
            assert await asyncio.to_thread(recorder.flush, PATIENCE)
    files = sorted(tmp_path.iterdir())
    assert len(files) > 3 and all(f.suffix == ".mcap" for f in files)
    assert all(60e3 <= f.stat().st_size < 90e3 for f in files[:-1])
    recording = Recording.open(tmp_path)
    assert recording.paths == tuple(files)
    assert recording.batches("arm", "rtde").sequence.tolist() == list(range(3000))
    assert recorder.stats()["files"] == len(files)


async def test_files_rotate_by_age(tmp_path, monkeypatch):
    monkeypatch.setattr("cellwatt.record.writer.IDLE", 0.01)
    async with started(RecordSettings(folder=tmp_path, file_age=0.05)) as recorder:
        assert recorder.put(batch_of(0, 1))
        await eventually(lambda: list(tmp_path.glob("*.mcap")))
        assert recorder.stats()["file"] is None
        assert recorder.put(batch_of(1, 1))
        await eventually(lambda: len(list(tmp_path.glob("*.mcap"))) == 2)
    assert [b.sequence for b in Recording.open(tmp_path).entries()] == [0, 1]


async def test_another_declaration_goes_into_another_file(recorder, tmp_path):
    other = Stream(ARM.name, (Channel("supply.power", "W"),), 10.0, "host")
    assert recorder.put(batch_of(0, 1))
    assert recorder.put(batch_of(1, 2, stream=other))
    assert recorder.put(batch_of(3, 2, stream=Stream(*[getattr(other, n) for n in Stream.__slots__])))
    assert recorder.put(frames_of(0, 2)) and recorder.put(frames_of(2, 2, channels=4))
    await recorder.close()
    assert len(list(tmp_path.glob("*.mcap"))) == 3
    assert [b.stream for b in Recording.open(tmp_path).entries()] == [ARM, other, other]
    with pytest.raises(RecordingError, match="layout of the frames changes"):
        Recording.open(tmp_path).frames_table()


async def test_new_settings_begin_a_new_file(recorder, tmp_path):
    assert recorder.put(batch_of(0, 1))
    recorder.redeclare(replace(HEADER, settings="changed"))
    assert recorder.put(batch_of(1, 1))
    await recorder.close()
    first, second = (Recording.open(p) for p in sorted(tmp_path.iterdir()))
    assert (first.header.settings, second.header.settings) == (HEADER.settings, "changed")
    assert (next(first.entries()).sequence, next(second.entries()).sequence) == (0, 1)


async def test_what_cannot_be_written_is_counted_and_the_rest_goes_on(recorder, tmp_path):
    assert recorder.put(replace(batch_of(0, 2), values=np.zeros((2, 3))))
    assert recorder.put(Event(SESSION, None, "odd", "x", {"object": object()}))
    assert recorder.put(batch_of(2, 1))
    await recorder.close()
    assert recorder.stats()["drops"] == {"/raw/arm/rtde": 2, "/event": 1}
    assert [b.sequence for b in Recording.open(tmp_path).entries()] == [2]


async def test_a_start_repairs_what_the_last_run_left(tmp_path):
    write_chunks(tmp_path, [[batch_of(0, 5)]], number=1)
    write_chunks(tmp_path, [[batch_of(5, 5)], [batch_of(10, 5)]], number=2, close=False)
    torn = tmp_path / (name_of(2) + PART)
    torn.write_bytes(torn.read_bytes()[:-30])
    (tmp_path / (name_of(3) + PART)).write_bytes(b"")
    async with started(RecordSettings(folder=tmp_path), replace(HEADER, session=SESSION + 10**12)) as recorder:
        assert recorder.put(batch_of(0, 1))
        reports = await recorder.upkeep.recovered()
    assert [r.part.name for r in reports] == [name_of(3) + PART, name_of(2) + PART]
    assert "was empty" in str(reports[0]) and "10 messages recovered, lost: " in str(reports[1])
    assert recorder.stats()["recovered"] == [str(r) for r in reports]
    assert Recording.open(tmp_path).batches("arm", "rtde").sequence.tolist() == [*range(15), 0]


async def test_recordings_of_several_cells_are_not_mixed(tmp_path):
    for cell in ("weld-3", "weld-4"):
        async with started(RecordSettings(folder=tmp_path), replace(HEADER, cell=cell)) as recorder:
            assert recorder.put(batch_of(0, 1))
    with pytest.raises(RecordingError, match="several cells"):
        Recording.open(tmp_path)


async def test_the_loop_is_never_blocked(recorder):
    with blockbuster_ctx():  # of files, too, which a test may else touch
        for n in range(50):
            assert recorder.put(batch_of(n * 10, 10))
            recorder.stats()
        await asyncio.sleep(0)
