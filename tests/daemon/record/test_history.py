import asyncio
import threading
from dataclasses import replace
from pathlib import Path

import pytest

from cellwatt.errors import RepairingError
from cellwatt.frames import cut
from cellwatt.record import History, Recording, RecordSettings
from cellwatt.record.header import PART
from cellwatt.record.survey import survey
from cellwatt.record.upkeep import Upkeep
from cellwatt.results import Prediction
from tests.blocks import same_frames
from tests.patience import PATIENCE, eventually

from ..outlets.zenoh.fake_cell import alarm, task
from .making import HEADER, METER, SESSION, batch_of, frames_of, name_of, same_batch, started, write_chunks


@pytest.fixture
async def recorder(tmp_path):
    async with started(RecordSettings(folder=tmp_path, flush=3600.0, file_size=40e3)) as recorder:
        yield recorder


@pytest.fixture
async def history(recorder, tmp_path):
    """3000 samples of the arm and 600 of the supply, in several closed files and an open one, some still in memory."""
    for n in range(300):
        assert recorder.put(batch_of(n * 10, 10))
        assert recorder.put(batch_of(n * 2, 2, stream=METER, source="supply"))
        if n % 10 == 0:
            assert await asyncio.to_thread(recorder.flush, PATIENCE)
    await eventually(lambda: len(list(tmp_path.glob("*.mcap"))) >= 3)
    return History(tmp_path, recorder)


def numbers(batches):
    return [s for b in batches for s in range(b.sequence, b.sequence + len(b))]


async def ask(history, *question):
    return await asyncio.to_thread(history.history, *question)


async def results(history, series, first, count):
    return await asyncio.to_thread(history.results, series, SESSION, first, count)


@pytest.mark.parametrize(("first", "count"), [(0, 1), (7, 3), (1, 2998), (2985, 15), (1500, 0)])
async def test_just_what_was_asked_for(history, first, count):
    found = await ask(history, "arm", "rtde", SESSION, first, count)
    assert numbers(found) == list(range(first, first + count))
    for batch in found:
        inside = batch.sequence % 10
        truth = cut(batch_of(batch.sequence - inside, 10), inside, inside + len(batch))
        # A part of a batch was made known when the whole of it was.
        assert same_batch(batch, truth)


async def test_what_is_left_after_a_number_is_found_however_far(history, tmp_path):
    assert await ask(history, "arm", "rtde", SESSION, 5000, 10) == []
    for path in sorted(tmp_path.glob("*.mcap"))[:2]:
        path.unlink()
    left = numbers(await ask(history, "arm", "rtde", SESSION, 0, 3000))
    assert left[0] > 500 and left == list(range(left[0], 3000))
    assert numbers(await ask(history, "arm", "rtde", SESSION, 0, 100)) == left[:100]
    assert numbers(await ask(history, "arm", "rtde", SESSION, left[0] - 50, 100)) == left[:50]
    assert numbers(await ask(history, "arm", "rtde", SESSION, 2995, 100)) == list(range(2995, 3000))


async def test_every_stream_is_found_for_itself(history):
    assert numbers(await ask(history, "supply", "meter", SESSION, 100, 300)) == list(range(100, 400))
    assert await ask(history, "supply", "rtde", SESSION, 0, 10) == []
    assert await ask(history, "arm", "rtde", SESSION + 1, 0, 10) == []


async def test_damage_is_passed_over(history, recorder, tmp_path):
    await recorder.close()
    path = sorted(tmp_path.glob("*.mcap"))[1]
    data = bytearray(path.read_bytes())
    chunks = survey(path).contents.chunks
    data[chunks[len(chunks) // 2].offset + 200] ^= 1
    path.write_bytes(data)
    left = Recording.open(tmp_path).batches("arm", "rtde").sequence.tolist()
    assert 2000 < len(left) < 3000
    for first in range(0, 3000, 97):
        found = numbers(await ask(history, "arm", "rtde", SESSION, first, 50))
        assert found == [n for n in left if first <= n < first + 50]


async def test_earlier_sessions_are_served(tmp_path, recorder):
    write_chunks(tmp_path, [[batch_of(0, 5)], [batch_of(5, 5)]], number=1)
    old = tmp_path / name_of(1).replace("20261121T095923", "20261120T000000")
    (tmp_path / name_of(1)).rename(old)
    session = SESSION - (86400 + 9 * 3600 + 59 * 60 + 23) * 10**9
    history = History(tmp_path, recorder)
    (listed,) = history.recordings()
    assert numbers(await ask(history, "arm", "rtde", listed["session"], 3, 4)) == [3, 4, 5, 6]
    assert listed["session"] == session


async def test_a_hole_in_the_numbers_is_a_hole_in_the_answer(recorder, tmp_path):
    for first in (0, 10, 40, 50):
        assert recorder.put(batch_of(first, 10))
    found = await ask(History(tmp_path, recorder), "arm", "rtde", SESSION, 5, 50)
    assert numbers(found) == [*range(5, 20), *range(40, 55)]
    later = await ask(History(tmp_path, recorder), "arm", "rtde", SESSION, 20, 15)
    assert numbers(later) == list(range(40, 55)), "nothing is left of 20 … 34"


async def test_just_the_frames_that_were_asked_for(recorder, tmp_path):
    for n in range(30):
        assert recorder.put(batch_of(n * 10, 10)) and recorder.put(frames_of(n * 10, 10))
    history = History(tmp_path, recorder)
    found = await asyncio.to_thread(history.frames, SESSION, 95, 20)
    assert numbers(found) == list(range(95, 115))
    for frames in found:
        inside = frames.sequence % 10
        truth = cut(frames_of(frames.sequence - inside, 10), inside, inside + len(frames))
        assert same_frames(frames, truth)
    assert await asyncio.to_thread(history.frames, SESSION, 300, 10) == []


def prediction(number: int, model: str) -> Prediction:
    return Prediction(model, number, (SESSION + number,), {"power": (float(number),)}, {"power": "W"})


@pytest.fixture
async def judged(recorder, tmp_path):
    """Tasks 5 … 605 and what two models said, in several closed files and an open one, some still in memory."""
    for n in range(600):
        assert recorder.put(task(n), n + 5)
        assert recorder.put(prediction(n, "a/b"), n)
        assert n % 2 or recorder.put(prediction(n, "other"), n // 2)
        assert recorder.put(alarm(n))
        if n % 15 == 0:
            assert await asyncio.to_thread(recorder.flush, PATIENCE)
    await eventually(lambda: len(list(tmp_path.glob("*.mcap"))) >= 2)
    return History(tmp_path, recorder)


async def test_models_are_numbered_each_for_itself(judged):
    assert await results(judged, "prediction/other", 299, 10) == [(299, prediction(598, "other"))]
    assert await results(judged, "task", 100, 200) == [(n, task(n - 5)) for n in range(100, 300)]
    assert await results(judged, "prediction/a/b", 299, 2) == [(n, prediction(n, "a/b")) for n in (299, 300)]


async def test_of_results_that_are_gone_those_after_them_are_given(judged, tmp_path):
    sorted(tmp_path.glob("*.mcap"))[0].unlink()
    ((number, left), *_) = await results(judged, "task", 0, 3)
    assert number > 50 and left == task(number - 5)
    assert await results(judged, "task", 700, 3) == []


async def test_what_has_no_numbers_is_recorded_and_not_given_by_number(judged, recorder, tmp_path):
    assert await results(judged, "alarm", 0, 3) == []
    await recorder.close()
    recording = Recording.open(tmp_path)
    assert recording.alarms() == [alarm(n) for n in range(600)]
    made = [prediction(n, m) for n in range(600) for m in ("a/b", "other") if m == "a/b" or n % 2 == 0]
    assert list(recording.results(Prediction)) == made


async def test_one_without_a_number_stands_beside_those_that_have_one(recorder, tmp_path):
    """What a process told and its journal lost again is recorded by the next one as it is."""
    for item, number in ((task(1), 7), (task(2), None), (task(3), 8)):
        assert recorder.put(item, number)
    assert await results(History(tmp_path, recorder), "task", 0, 10) == [(7, task(1)), (8, task(3))]
    await recorder.close()
    assert Recording.open(tmp_path).tasks() == [task(1), task(2), task(3)]


async def test_what_is_being_repaired_is_not_said_to_be_gone(tmp_path, monkeypatch):
    """A daemon that was killed left the second of two files open; the next one is asked before it is repaired."""
    write_chunks(tmp_path, [[batch_of(0, 10)]], number=1)
    write_chunks(tmp_path, [[batch_of(10, 10), frames_of(0, 10)]], number=2, close=False)
    begin, repair = threading.Event(), Upkeep._recover

    def late(upkeep: Upkeep, part: Path) -> object:
        begin.wait(PATIENCE)
        return repair(upkeep, part)

    monkeypatch.setattr(Upkeep, "_recover", late)
    async with started(RecordSettings(folder=tmp_path), replace(HEADER, session=SESSION + 1)) as recorder:
        history = History(tmp_path, recorder)
        frames = lambda: asyncio.to_thread(history.frames, SESSION, 0, 10)  # noqa: E731
        assert numbers(await ask(history, "arm", "rtde", SESSION, 5, 10)) == list(range(5, 10))
        for asking in (ask(history, "arm", "rtde", SESSION, 10, 10), frames()):
            with pytest.raises(RepairingError, match="is being repaired: ask again"):
                await asking
        assert await ask(history, "arm", "rtde", SESSION + 1, 0, 10) == []
        begin.set()
        await recorder.upkeep.recovered()
        assert numbers(await ask(history, "arm", "rtde", SESSION, 10, 10)) == list(range(10, 20))
        assert numbers(await frames()) == list(range(10))
        assert await ask(history, "arm", "rtde", SESSION, 20, 10) == []


async def test_the_files_are_listed(history, recorder, tmp_path):
    await eventually(lambda: len(list(tmp_path.glob(f"*{PART}"))) <= 1)
    (tmp_path / (name_of(99) + PART)).write_bytes(b"torn")
    listed = await asyncio.to_thread(history.recordings)
    assert [r["file"] for r in listed] == sorted(p.name for p in tmp_path.iterdir())
    live = recorder.live()
    states = ["open" if live and r["file"] == live[0].name else "closed" for r in listed[:-1]]
    assert [r["state"] for r in listed] == [*states, "left open"]
    assert listed[0]["start"] == SESSION and listed[0]["end"] > SESSION
    assert all(r["session"] == SESSION for r in listed)
    assert [r["bytes"] for r in listed] == [(tmp_path / r["file"]).stat().st_size for r in listed]
    await recorder.close()
    states = [r["state"] for r in History(tmp_path, recorder).recordings()]
    assert set(states[:-1]) == {"closed"}
