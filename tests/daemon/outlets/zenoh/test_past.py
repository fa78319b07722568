"""Frames, and results that memory no longer has, answered from real recordings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cellwatt import FrameChannel, Frames
from cellwatt.frames import concatenate
from cellwatt.outlets.zenoh.answer_queue import MOST_RESULTS, MOST_SAMPLES, Answer, Past
from cellwatt.outlets.zenoh.backlog import Backlog
from cellwatt.outlets.zenoh.encode import decode
from cellwatt.outlets.zenoh.mark import Mark
from cellwatt.outlets.zenoh.messages import from_json, parse_json
from cellwatt.outlets.zenoh.questions import NothingKeptError
from cellwatt.record import History, Recorder, RecordSettings
from cellwatt.record.encoder import Encoder
from cellwatt.record.openfile import OpenFile
from cellwatt.results import Event, Result
from tests.blocks import same_frames
from tests.daemon.outlets.zenoh.fake_cell import task
from tests.daemon.outlets.zenoh.recorded_cell import RecordedView
from tests.daemon.record.making import HEADER, SESSION, frames_of, name_of, write_chunks

BLOCK = 10
END = 6000
FILES = ((0, 2500), (2500, 4000), (4000, END))


def blocks(first: int, end: int) -> list[Frames]:
    return [frames_of(number, BLOCK) for number in range(first, end, BLOCK)]


class Recorded(RecordedView):
    """A cell that is recorded in ``folder``; nobody writes there now."""

    def __init__(self, folder: Path, session: int = SESSION) -> None:
        super().__init__(History(folder, Recorder(RecordSettings(folder=folder), HEADER)), session)

    def result_history(self, series: str, session: int, first: int, count: int) -> Sequence[tuple[int, Result | Event]]:
        assert 0 < count <= MOST_RESULTS
        return super().result_history(series, session, first, count)


@pytest.fixture(scope="module")
def truth() -> list[Frames]:
    return blocks(0, END)


@pytest.fixture
def folder(tmp_path: Path, truth: list[Frames]) -> Path:
    for number, (first, end) in enumerate(FILES, 1):
        of_file = truth[first // BLOCK : end // BLOCK]
        write_chunks(tmp_path, [of_file[n : n + 20] for n in range(0, len(of_file), 20)], number=number)
    return tmp_path


def ask(past: Past, first: int, session: int = SESSION, **more: int) -> Answer:
    asked = {"session": session, "first": first, **more}
    return past.history({"stream": "frame", **{name: str(number) for name, number in asked.items()}})


def answers(past: Past, first: int, count: int) -> Iterator[tuple[Mark, Frames]]:
    """What a consumer gets that asks until it has all."""
    end = first + count
    while first < end:
        answer = ask(past, first, count=end - first)
        assert answer.mark is not None
        frames = decode(answer.payload, answer.mark)
        assert isinstance(frames, Frames)
        yield answer.mark, frames
        first = answer.mark.end


@pytest.mark.parametrize("piece", [1e9, 30e3])
def test_all_frames_once_in_order(folder: Path, truth: list[Frames], piece: float) -> None:
    past = Past(Recorded(folder), Backlog(SESSION), lambda: piece)
    given = list(answers(past, 0, END))
    assert same_frames(concatenate([frames for _, frames in given]), concatenate(truth))
    assert all((m.session, m.sequence, m.count) == (SESSION, f.sequence, len(f)) for m, f in given)
    assert all(m.backfill and m.arrival == f.time[-1] for m, f in given)
    assert 1 < max(m.count for m, _ in given) <= min(MOST_SAMPLES, piece / 80)


@pytest.mark.parametrize(("first", "count"), [(7, 3), (2495, 10), (END - 1, 1)])
def test_just_the_frames_that_were_asked_for(folder: Path, first: int, count: int) -> None:
    past = Past(Recorded(folder), Backlog(SESSION), lambda: 1e9)
    (numbers,) = [(f.sequence, len(f)) for _, f in answers(past, first, count)]
    assert numbers == (first, count)


def test_where_frames_are_gone_the_answer_begins_with_the_first_that_is_left(folder: Path) -> None:
    past = Past(Recorded(folder), Backlog(SESSION), lambda: 1e9)
    sorted(folder.glob("*.mcap"))[0].unlink()
    assert next(m.sequence for m, _ in answers(past, 100, END - 100)) == FILES[1][0]
    with pytest.raises(NothingKeptError, match="no frames are stored from 100"):
        ask(past, 100, count=FILES[1][0] - 100)


def test_frames_of_an_earlier_session_to_its_end(folder: Path) -> None:
    past = Past(Recorded(folder, SESSION + 10**9), Backlog(SESSION + 10**9), lambda: 1e9)
    first = 1000
    for _ in range(10):
        try:
            answer = ask(past, first)  # without a count: to the end, which only the record knows
        except NothingKeptError:
            break
        assert answer.mark is not None
        assert (answer.mark.session, answer.mark.sequence) == (SESSION, first)
        first = answer.mark.end
    assert first == END


def test_frames_of_another_layout_are_another_answer(tmp_path: Path) -> None:
    other = (FrameChannel("arm.supply.power", "W", "continuous", "average"),)
    old = frames_of(0, 20)
    new = replace(frames_of(20, 20, channels=1), layout=replace(old.layout, channels=other))
    write_chunks(tmp_path, [[old]], number=1)
    write_chunks(tmp_path, [[new]], number=2)
    given = [f for _, f in answers(Past(Recorded(tmp_path), Backlog(SESSION), lambda: 1e9), 5, 35)]
    assert [(f.sequence, len(f), f.layout.names) for f in given] == [
        (5, 15, old.layout.names),
        (20, 20, ("arm.supply.power",)),
    ]


@pytest.fixture
def judged(tmp_path: Path) -> Path:
    """Tasks 0 … 2000 on disk."""
    recorded = 0
    for number in (1, 2):
        file = OpenFile(tmp_path / name_of(number), replace(HEADER, number=number))
        encoder = Encoder(file)
        for _ in range(20):
            for _ in range(50):
                encoder.add(task(recorded), recorded)
                recorded += 1
            file.write_chunk()
        file.finish()
        file.publish()
    return tmp_path


def told(past: Past, first: int, session: int = SESSION, **more: int) -> list[tuple[int, Any]]:
    asked = {"session": session, "first": first, **more}
    answer = past.results({"kind": "task", **{name: str(number) for name, number in asked.items()}})
    return [(body["mark"]["sequence"], from_json("task", body)) for body in parse_json(answer.payload)]


def test_all_results_once_in_order_first_from_the_record_then_from_memory(judged: Path) -> None:
    backlog = Backlog(SESSION)
    for number in range(2000):
        backlog.add(task(number))
    kept = backlog._kept["task"]
    while len(kept) > 100:
        kept.popleft()
    past, given = Past(Recorded(judged), backlog, lambda: 1e9), []
    while len(given) < 2000:
        given += told(past, len(given), count=2000 - len(given))
    assert given == [(number, task(number)) for number in range(2000)]
    assert told(past, 1898, count=4) == [(1898, task(1898)), (1899, task(1899))], "the rest is in memory"
    assert told(past, 1990, count=3) == [(number, task(number)) for number in range(1990, 1993)]


def test_results_of_an_earlier_session_to_its_end(judged: Path) -> None:
    past, given = Past(Recorded(judged, SESSION + 1), Backlog(SESSION + 1), lambda: 1e9), []
    with pytest.raises(NothingKeptError, match="no results 'task' are stored"):
        while True:
            given += told(past, len(given))
    assert given == [(number, task(number)) for number in range(2000)]


def test_where_results_are_gone_the_answer_begins_with_the_first_that_is_left(judged: Path) -> None:
    past = Past(Recorded(judged), Backlog(SESSION), lambda: 1e9)
    sorted(judged.glob("*.mcap"))[0].unlink()
    assert told(past, 3)[0] == (1000, task(1000))
    with pytest.raises(NothingKeptError):
        told(past, 3, count=997)
