"""Curves out of recordings: true extremes whatever the span, from level files that may be damaged or missing."""

from __future__ import annotations

import asyncio
import errno
import json
import math
import os
import tempfile
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt.errors import RecordingError
from cellwatt.outlets.page.levels import curves as module
from cellwatt.outlets.page.levels import episodes, level_file, store
from cellwatt.outlets.page.levels.buckets import STEPS, chosen
from cellwatt.outlets.page.levels.curves import curves
from cellwatt.outlets.page.levels.following import gather
from cellwatt.outlets.page.levels.store import Store
from cellwatt.record import Recorder, RecordSettings, recover
from cellwatt.record.header import FileName
from cellwatt.record.survey import in_folder, survey
from tests.daemon.outlets.page.recorded import (
    CELL,
    HEADER,
    MS,
    SESSION,
    STEP,
    S,
    Written,
    alarm,
    frames,
    interval,
    prediction,
    recording,
)
from tests.patience import wait_until

START = SESSION / MS  # ms
LARGEST = float(np.finfo(np.float32).max)
FIVE_MINUTES = SESSION + np.arange(300) * S
SPAN = (["arm.power"], START, START + 300_000, 30)


def extremes(time: np.ndarray, values: np.ndarray, edges: list[float], step: float) -> tuple[list, list]:
    """Of the samples from each edge (ms) on: by a loop over all of them."""
    low: dict[int, float] = {}
    high: dict[int, float] = {}
    for t, v in zip(time.tolist(), values.tolist(), strict=True):
        place = (t - round(edges[0] * MS)) // round(step * MS)
        if math.isfinite(v) and 0 <= place < len(edges):
            low[place], high[place] = min(v, low.get(place, v)), max(v, high.get(place, v))
    return [low.get(i) for i in range(len(edges))], [high.get(i) for i in range(len(edges))]


def same(found: list, true: list) -> bool:
    """Equal as single-precision numbers, and None in the same places."""
    return [*map(single, found)] == [*map(single, true)]


def single(value: float | None) -> np.float32 | None:
    return None if value is None else np.float32(np.clip(value, -LARGEST, LARGEST))


def in_chunks(time: np.ndarray, values: np.ndarray, size: int, **more) -> list:
    return [[frames(time[i : i + size], values[i : i + size], **more)] for i in range(0, len(time), size)]


# extremes -------------------------------------------------------------------------------------------

GAPS = st.lists(st.integers(1, 400), min_size=1, max_size=5)
SPIKES = st.lists(st.tuples(st.integers(0, 10**6), st.sampled_from([1e9, -1e9, math.nan, math.inf, -math.inf, 1e300])))


@settings(max_examples=60, deadline=None)
@given(
    st.integers(0, 2**32),
    GAPS,
    SPIKES,
    st.integers(1, 40),
    st.lists(st.integers(1, 3), min_size=1, max_size=3),
    st.floats(0, 0.9),
    st.floats(0.001, 1),
    st.integers(2, 300),
    st.sampled_from([STEP, 10 * STEP, 500 * STEP]),
)
def test_every_step_has_the_true_extremes(seed, gaps, spikes, chunk, files, begin, length, points, step):
    random = np.random.default_rng(seed)
    ticks = np.cumsum(np.concatenate([[g, *np.ones(random.integers(1, 300), int)] for g in gaps]))
    time = SESSION + ticks * step
    values = random.standard_normal(len(time)).cumsum()
    for place, value in spikes:
        values[place % len(values)] = value
    parts = np.array_split(np.arange(len(time)), len(files))
    start = START + begin * (time[-1] - SESSION) / MS
    end = start + max(length * (time[-1] - SESSION + step) / MS, 0.001)
    with tempfile.TemporaryDirectory() as folder:
        for number, part in enumerate(parts, 1):
            if len(part):
                recording(Path(folder), in_chunks(time[part], values[part], chunk, rate=1e9 / step), number)
        found = curves(Store(Path(folder), CELL), ["arm.power"], start, end, points)
    assert len(found["t"]) <= points
    assert found["complete"] and found["from_record"]
    given_ = found["v"]["arm.power"]
    if "max" in given_:
        low, high = extremes(time, values, found["t"], found["step_ms"])
        assert same(given_["min"], low) and same(given_["max"], high)
        newest = time[time / MS < end].max(initial=0) / MS  # nothing need be drawn in a gap behind it
        assert found["t"][0] <= start and found["t"][-1] + found["step_ms"] >= newest
    else:
        shown = {round(t * MS): v for t, v in zip(found["t"], given_["min"], strict=True) if v is not None}
        kept = (time / MS >= found["t"][0]) & (time / MS < end) & np.isfinite(values)
        assert dict(zip(time[kept].tolist(), values[kept].tolist(), strict=True)) == pytest.approx(shown)
    assert found["t"] == sorted(set(found["t"]))
    assert json.loads(json.dumps(found, allow_nan=False)) == found


@given(st.integers(0, 10**18), st.integers(1, 40 * 86400 * S), st.integers(2, 5000))
def test_levels_read_are_few_for_each_point(start, length, points):
    level, grid = chosen(start, start + length, points)
    assert grid.count <= points
    assert grid.start <= start and grid.end >= start + length
    assert grid.step % STEPS[level] == 0
    if length < 86400 * S * points:  # up to 500 days in 500 points
        assert grid.count * grid.step / STEPS[level] <= 31 * max(points, 4) or level == len(STEPS) - 1
    if level:
        assert grid.step >= 3 * STEPS[level]


def test_what_a_killed_process_left_of_its_level_files_goes_and_nothing_else(tmp_path: Path) -> None:
    recording(tmp_path, [[interval(1, SESSION, SESSION + S)]])
    reader = Store(tmp_path, CELL)
    reader.look(lambda: None)
    (file,) = (tmp_path / "levels").iterdir()
    left = file.with_name(f"{file.name}.7-7.new")
    left.touch()
    reader.start()
    wait_until(lambda: not left.exists(), "the end of what was left")
    reader.close()
    assert [*file.parent.iterdir()] == [file]


# spans ----------------------------------------------------------------------------------------------


def hours(folder: Path, count: int = 3, names: tuple[str, ...] = ("arm.power", "arm.voltage")) -> tuple:
    """Recordings of an hour each, one frame a second; what to ask for to see the power of all of them."""
    time = SESSION + np.arange(3600 * count) * S
    values = np.random.default_rng(1).standard_normal((len(time), len(names)))
    values[3000, 0] = 1000.0
    for number in range(count):
        part = slice(3600 * number, 3600 * (number + 1))
        recording(folder, in_chunks(time[part], values[part], 600, names=names, rate=1.0), number + 1)
    return ["arm.power"], START, START + count * 3_600_000, 100


def test_channels_may_change_from_file_to_file(tmp_path):
    first, second = SESSION + np.arange(100) * S, SESSION + np.arange(100, 200) * S
    recording(tmp_path, [[frames(first, np.arange(100), ("arm.power",), 1.0)]], 1)
    both = np.stack([np.arange(100) * 2, np.arange(100) * 3], axis=1)
    recording(tmp_path, [[frames(second, both, ("mains.power", "arm.power"), 1.0)]], 2)
    found = curves(Store(tmp_path, CELL), ["arm.power", "mains.power"], START, START + 200_000, 20)
    assert found["step_ms"] == 10_000.0
    assert found["v"]["arm.power"]["max"][:11] == [*range(9, 100, 10), 27.0]
    assert found["v"]["mains.power"]["min"] == [None] * 10 + [*range(0, 200, 20)]
    nothing = curves(Store(tmp_path / "nowhere", CELL), ["arm.power"], START, START + 1000, 100)
    assert nothing["complete"] and set(nothing["v"]["arm.power"]["min"]) == {None}


def test_predictions_are_channels(tmp_path):
    time = SESSION + np.arange(3000) * STEP
    said = np.cos(np.arange(3000) / 50)
    chunks = [[prediction(time[i : i + 50].tolist(), total=said[i : i + 50].tolist())] for i in range(0, 3000, 50)]
    recording(tmp_path, [[*c, *f] for c, f in zip(chunks, in_chunks(time, 2 * said, 50), strict=True)])
    reader = Store(tmp_path, CELL)
    name = "prediction/power/total"
    short = curves(reader, [name, "arm.power"], START, START + 2000, 100)
    assert short["v"][name]["min"] == said[:100].tolist()
    assert short["v"]["arm.power"]["min"] == (2 * said[:100]).tolist()
    long = curves(reader, [name], START, START + 60_000, 60)
    low, high = extremes(time, said, long["t"], long["step_ms"])
    assert same(long["v"][name]["min"], low) and same(long["v"][name]["max"], high)


def test_cells_that_share_a_folder_do_not_mix(tmp_path):
    time = SESSION + np.arange(100) * S
    recording(tmp_path, [[frames(time, np.ones(100), rate=1.0)]])
    recording(tmp_path, [[frames(time, np.full(100, 7.0), rate=1.0)]], cell="other")
    for cell, value in ((CELL, 1.0), ("other", 7.0)):
        reader = Store(tmp_path, cell)
        found = curves(reader, ["arm.power"], START, START + 100_000, 10)
        assert set(found["v"]["arm.power"]["max"]) == {value}
        reader.look(int)
    assert len(list((tmp_path / "levels").iterdir())) == 2


# open recordings ------------------------------------------------------------------------------------


def test_a_recording_that_was_followed_and_repaired_is_whole(tmp_path):
    time = SESSION + np.arange(1000) * STEP
    written, reader = Written(tmp_path), Store(tmp_path, CELL)
    for i in range(0, 1000, 100):
        written.chunk(frames(time[i : i + 100], np.arange(i, i + 100)))
    span = (["arm.power"], START, START + 20_000, 50)
    part = written.crash()
    os.truncate(part, part.stat().st_size - 400)
    torn = curves(reader, *span)
    repaired = recover(part)
    assert repaired is not None and repaired.result is not None
    low, high = extremes(time, np.arange(1000), torn["t"], 400.0)  # the index of the last chunk alone was torn
    reader.look(int)
    assert level_file.path_of(repaired.result).exists()
    for each in (reader, Store(tmp_path, CELL)):
        assert curves(each, *span)["v"] == {"arm.power": {"min": low, "max": high}}


def test_a_damaged_chunk_leaves_a_gap(tmp_path):
    time = SESSION + np.arange(1000) * STEP
    random = np.random.default_rng(3).standard_normal(1000)
    written = Written(tmp_path)
    for (block,) in in_chunks(time, random, 100):
        written.chunk(block)
    chunk = written.file.contents.chunks[4]
    with written.file.part.open("r+b") as file:
        file.seek(chunk.offset + chunk.length // 2)
        file.write(b"\xff\x00\xff\x00")
    for look in ("open", "closed"):
        if look == "closed":
            written.close()
        found = curves(Store(tmp_path, CELL), ["arm.power"], START, START + 20_000, 40)
        low = extremes(np.delete(time, range(400, 500)), np.delete(random, range(400, 500)), found["t"], 600.0)[0]
        assert same(found["v"]["arm.power"]["min"], low)


def test_curves_of_a_recorder_at_work_are_true_while_files_come_and_go(tmp_path, monkeypatch):
    """The product's own recorder, in files of some 200 frames, of which retention keeps the last few."""
    monkeypatch.setattr("cellwatt.outlets.page.levels.store.PERIOD", 0.02)
    monkeypatch.setattr("cellwatt.outlets.page.levels.curves.PATIENCE", 60.0)
    random = np.random.default_rng(7)
    count = 2000
    time = SESSION + np.arange(count) * STEP
    values = random.standard_normal((count, 30)).cumsum(axis=0)
    names = tuple(f"arm.c{i}" for i in range(30))
    settings_ = RecordSettings(folder=tmp_path, keep="200 kB", file_size="40 kB", flush="10 ms")
    recorder, reader = Recorder(settings_, HEADER), Store(tmp_path, CELL)
    recorder.start()
    reader.start()
    try:
        for i in range(0, count, 50):
            assert recorder.put(frames(time[i : i + 50], values[i : i + 50], names))
            assert recorder.flush(60)
            end = time[i + 49] / MS + 20
            found = curves(reader, ["arm.c7"], max(end - 1000, START), end, 500)
            assert found["v"]["arm.c7"]["min"] == values[i : i + 50, 7].tolist()
            whole = curves(reader, ["arm.c7"], START, end, 400)
            low, high = extremes(time[: i + 50], values[: i + 50, 7], whole["t"], whole["step_ms"])
            given_ = whole["v"]["arm.c7"]
            assert whole["complete"]
            drawn = np.array([v is not None for v in given_["min"]])
            assert drawn[np.array(whole["t"]) >= begin_of(tmp_path)].all()
            # Beside a step without values, some values of a step may have been removed, too.
            inner = np.flatnonzero(drawn & np.append(False, drawn[:-1]) & np.append(drawn[1:], True))
            for measured, true in ((given_["min"], low), (given_.get("max", given_["min"]), high)):
                assert same([measured[k] for k in inner], [true[k] for k in inner])
    finally:
        asyncio.run(recorder.close())
        stems = lambda kind: {path.stem for path in tmp_path.rglob(f"*.{kind}")}  # noqa: E731
        wait_until(lambda: stems("levels") == stems("mcap"))
        reader.close()
    assert reader.counts["level files damaged"] == 0
    first_file = FileName.parse(min(tmp_path.glob("*.mcap")).name)
    assert first_file is not None and first_file.number > 1, "retention removed some"


def begin_of(folder: Path) -> float:
    """Time, UTC ms, of the first frame that retention has not removed."""
    for path in in_folder(folder):
        with suppress(RecordingError):  # removed meanwhile
            return survey(path).contents.start / MS
    raise AssertionError(f"{folder} has no recording")


# level files ----------------------------------------------------------------------------------------


@settings(max_examples=80, deadline=None)
@given(st.data())
def test_no_damage_gives_wrong_numbers(data):
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        whole = frames(FIVE_MINUTES, np.arange(300), rate=1.0)
        path = recording(folder, [[whole, interval(1, SESSION, SESSION + S), alarm("a", SESSION, SESSION)]])
        true = curves(Store(folder, CELL), *SPAN)
        file = level_file.path_of(path)
        body = bytearray(file.read_bytes())
        for _ in range(data.draw(st.integers(1, 3))):
            body[data.draw(st.integers(0, len(body) - 1))] = data.draw(st.integers(0, 255))
        file.write_bytes(body[: data.draw(st.integers(0, len(body)))])
        reader = Store(folder, CELL)
        curves(reader, *SPAN)
        assert curves(reader, *SPAN) == true


def test_a_level_file_of_another_recording_is_not_used(tmp_path):
    path = recording(tmp_path, [[frames(FIVE_MINUTES, np.zeros(300), rate=1.0)]])
    curves(Store(tmp_path, CELL), *SPAN)
    path.unlink()
    recording(tmp_path, [[frames(FIVE_MINUTES, np.arange(300), rate=1.0)]])
    assert curves(Store(tmp_path, CELL), *SPAN)["v"]["arm.power"]["max"] == [*range(9, 300, 10)]


def test_a_damaged_level_file_that_cannot_be_removed_leaves_a_gap_that_is_told(tmp_path, monkeypatch):
    path = recording(tmp_path, [[frames(FIVE_MINUTES, np.zeros(300), rate=1.0)]])
    assert curves(Store(tmp_path, CELL), *SPAN)["complete"]
    reader = Store(tmp_path, CELL)
    asked = []
    monkeypatch.setattr(level_file.LevelFile, "levels", lambda *_: asked.append(1) or level_file._unpacked(b"a", 1))
    monkeypatch.setattr(Path, "unlink", lambda *_, **__: (_ for _ in ()).throw(OSError(errno.EROFS, "read-only")))
    assert not curves(reader, *SPAN)["complete"] and len(asked) == 2
    assert level_file.path_of(path).exists()


def test_levels_go_with_their_recording(tmp_path):
    span, reader = hours(tmp_path), Store(tmp_path, CELL)
    curves(reader, *span)
    (tmp_path / "levels" / "notes.txt").write_text("mine")
    min(tmp_path.glob("*.mcap")).unlink()
    reader.look(int)
    left = {path.name for path in (tmp_path / "levels").iterdir()}
    assert left == {"notes.txt", *(p.stem + ".levels" for p in tmp_path.glob("*.mcap"))} and len(left) == 3
    assert curves(reader, *span)["v"]["arm.power"]["max"][0] is None


def test_levels_keep_to_their_budget_and_the_oldest_go(tmp_path, monkeypatch):
    span = hours(tmp_path)
    true = curves(Store(tmp_path, CELL), *span)
    files = sorted((tmp_path / "levels").iterdir())
    read = []
    monkeypatch.setattr(store, "gather", lambda path, *more: read.append(path.stem) or gather(path, *more))
    reader = Store(tmp_path, CELL, sum(file.stat().st_size for file in files[1:]))
    for _ in range(2):
        reader.look(int)
    assert sorted((tmp_path / "levels").iterdir()) == files[1:]
    assert reader.counts["level files over budget"] == 1 and read == [], "it is not made anew at each look"
    assert curves(reader, *span) == true and set(read) == {files[0].stem}
    time = SESSION + 3 * 3600 * S + np.arange(3600) * S
    newest = recording(tmp_path, [[frames(time, np.arange(3600.0), rate=1.0)]], number=4)
    reader.look(int)
    assert sorted((tmp_path / "levels").iterdir()) == [files[2], level_file.path_of(newest)]


@pytest.mark.parametrize("full", [True, False])
def test_a_disk_that_takes_no_level_files_costs_time_alone(tmp_path, monkeypatch, caplog, full):
    span = hours(tmp_path)

    def refuse(*_):
        raise OSError(errno.EROFS, "Read-only file system")

    with monkeypatch.context() as patch:
        if full:
            patch.setattr(store, "RESERVE", 1e18)
        else:
            patch.setattr(level_file, "write", refuse)
        reader = Store(tmp_path, CELL)
        refused = curves(reader, *span)
        assert refused["complete"] and reader.counts["level files unwritten"] == 3
        reader.look(int)
        assert reader.counts["level files unwritten"] == 3, "not tried again at each look"
    assert ("too little disk space for level files" if full else "Read-only file system") in caplog.text
    assert not (tmp_path / "levels").exists()
    assert curves(Store(tmp_path, CELL), *span) == refused


def test_what_takes_too_long_is_left_out_and_told(tmp_path, monkeypatch):
    span = hours(tmp_path)
    monkeypatch.setattr(module, "PATIENCE", -1.0)
    found = curves(Store(tmp_path, CELL), *span)
    assert not found["complete"] and set(found["v"]["arm.power"]["max"]) == {None}


def test_a_recording_that_holds_nothing_is_told_and_not_read_again_and_again(tmp_path, monkeypatch, caplog):
    span = hours(tmp_path, 2)
    bad = min(tmp_path.glob("*.mcap"))
    bad.write_bytes(b"nothing" * 100)
    reader = Store(tmp_path, CELL)
    found = curves(reader, *span)
    assert curves(reader, *span) == found
    assert any(v is not None for v in found["v"]["arm.power"]["max"])
    assert reader.counts["unreadable recordings"] == 1
    assert bad.name in caplog.text


# what happened --------------------------------------------------------------------------------------


def test_intervals_and_alarms_come_with_the_curves(tmp_path):
    time = SESSION + np.arange(100) * S
    first = [
        frames(time[:50], np.ones(50), rate=1.0),
        interval(1, SESSION, SESSION + 10 * S, (1, 2)),
        interval(2, SESSION + 10 * S, SESSION + 49 * S, (), closed=False),
        alarm("a", SESSION + 5 * S, SESSION + 6 * S, severity="warning", statement="A"),
    ]
    second = [
        frames(time[50:], np.ones(50), rate=1.0),
        interval(2, SESSION + 10 * S, SESSION + 60 * S, ()),
        alarm("a", SESSION + 5 * S, SESSION + 70 * S, False, severity="warning", statement="gone"),
        alarm("b", SESSION + 80 * S, SESSION + 81 * S, statement="B"),
    ]
    recording(tmp_path, [first], 1)
    written = Written(tmp_path, 2).chunk(*second)
    reader = Store(tmp_path, CELL)
    whole = curves(reader, ["arm.power"], START, START + 100_000, 50)
    shape = {"source": "arm", "closed": True}
    assert whole["intervals"] == [
        {**shape, "number": 1, "start": START, "end": START + 10_000, "moving": [1, 2]},
        {**shape, "number": 2, "start": START + 10_000, "end": START + 60_000, "moving": []},
    ]
    a = {"id": "a", "severity": "warning", "statement": "A", "raised": START + 6000, "cleared": START + 70_000}
    b = {"id": "b", "severity": "error", "statement": "B", "raised": START + 81_000, "cleared": None}
    assert whole["alarms"] == [a, b]
    for start, end, expected in ((0, 5000, []), (20_000, 30_000, [a]), (75_000, 80_000, []), (90_000, 95_000, [b])):
        found = curves(reader, ["arm.power"], START + start, START + end, 1000)
        assert found["alarms"] == expected and found["complete"]
    written.crash()


def test_too_many_intervals_are_cut_to_the_longest(tmp_path, monkeypatch):
    monkeypatch.setattr(episodes, "MOST", 5)
    spans = [interval(i, SESSION + i * S, SESSION + i * S + (i + 1) * 10 * MS) for i in range(20)]
    recording(tmp_path, [spans])
    found = curves(Store(tmp_path, CELL), [], START, START + 100_000, 50)
    assert [i["number"] for i in found["intervals"]] == [15, 16, 17, 18, 19]
    assert not found["complete"]
