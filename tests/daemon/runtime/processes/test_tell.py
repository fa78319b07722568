"""The process that tells: alarms whose judge died are not left active, nor withdrawn twice; who follows one that was
killed records what that one told and did not write."""

from __future__ import annotations

import asyncio
import shutil
import time
from dataclasses import replace
from multiprocessing import Pipe
from pathlib import Path

import pytest

from cellwatt import Task
from cellwatt.record import Recorder, Recording, RecordSettings
from cellwatt.record.files import Files
from cellwatt.ring import ItemWriter, Status
from cellwatt.runtime.assemble import declared
from cellwatt.runtime.processes import tell
from cellwatt.runtime.processes.resume import Resume
from cellwatt.runtime.processes.shared import TELL, Assignment, Shared
from cellwatt.runtime.processes.tell import HUNG, SILENT, _Telling
from tests.daemon.outlets.zenoh.fake_cell import task
from tests.daemon.record.making import HEADER, batch_of, numbered_in
from tests.daemon.runtime.fakes import alarm, config_of, stages
from tests.patience import PATIENCE

CONFIG = config_of(stages=stages("heat"), outlets={})
BEGUN = Status({"begun": ["heat"]})
CONTROL = Pipe()[1]
"""Nobody says anything."""


@pytest.fixture
def shared() -> Shared:
    return Shared.of(*declared(CONFIG))


class Telling(_Telling):
    """A process that tells, begun by hand; ``left`` are the ids of the alarms that it takes for active."""

    def __init__(self, shared: Shared, restarts: int = 0) -> None:
        super().__init__(Assignment(shared, CONFIG, 1, CONTROL, restarts=restarts))
        self._resume = Resume()

    def left(self, judge: int = 0) -> list[str]:
        self._drain(self._results[judge])
        return [standing.alarm.id for standing in self._teller.alarms.raised]

    async def recording(self, folder: Path, *told: Task) -> Recorder:
        """Begin to record, behind what is in ``folder``; ``told`` come before it is known what that is."""
        recorder = self._teller.recorder = Recorder(RecordSettings(folder=folder), HEADER)
        recorder.start()
        for item in told:
            self._teller.take(item)
        await self._resume_record()
        return recorder


def test_a_judge_that_begins_ends_the_alarms_of_the_one_that_died(shared: Shared) -> None:
    said, telling = ItemWriter(shared.results[0]), Telling(shared)
    said.put(alarm("a", stage="heat"))
    said.put(alarm("b", stage="noise"))
    assert telling.left() == ["a", "b"]
    said.put(BEGUN)
    said.put(replace(alarm("c", stage="heat"), time=9))
    assert telling.left() == ["b", "c"]


def test_who_tells_next_does_not_withdraw_what_was_raised_since(shared: Shared) -> None:
    said, first = ItemWriter(shared.results[0]), Telling(shared)
    for item in (BEGUN, alarm("a", stage="heat")):
        said.put(item)
    assert first.left() == ["a"]
    assert Telling(shared).left() == ["a"]


def test_a_judge_in_another_place_ends_the_alarms_of_one_that_was_down_at_a_reload(shared: Shared) -> None:
    telling = Telling(shared)
    ItemWriter(shared.results[0]).put(alarm("a", stage="heat"))
    assert telling.left() == ["a"]
    ItemWriter(shared.results[1]).put(BEGUN)
    assert telling.left(1) == []


def test_at_the_end_nobody_who_is_silent_is_down(shared: Shared) -> None:
    telling = Telling(shared)
    telling._reports["align"] = time.monotonic() - 10.0, {"part": "align", "pid": 0, "cpu_s": 0.0, "restarts": 0}
    told: list[bool] = []
    telling._teller.on_health = lambda status: told.append(status["processes"]["align"]["down"])
    telling._look()
    shared.raw.end()
    telling._look()
    assert told == [True, False]


def test_a_process_that_hangs_is_reported_to_the_supervisor_unless_this_one_was_late(shared: Shared) -> None:
    telling = Telling(shared)
    supervisor, control = Pipe()
    telling._assignment = replace(telling._assignment, control=control)
    told: list[tuple[int, ...]] = []
    with supervisor, control:
        for telling._lag in (0.0, SILENT + 1.0):
            known = {"part": "align", "pid": -7, "cpu_s": 0.0, "restarts": 0}
            telling._reports["align"] = time.monotonic() - HUNG - 1.0, known
            telling._look()
            told.append(supervisor.recv().hung)
    assert told == [(-7,), ()]


@pytest.mark.parametrize("written", [0, 1, 3])
async def test_what_was_told_and_not_written_is_recorded_by_the_next_with_its_number(
    tmp_path: Path, shared: Shared, written: int
) -> None:
    """Of two judges, whose items the next process reads again in another order."""
    judges = [ItemWriter(shared.results[n]) for n in (0, 1)]
    first = Telling(shared)
    kept = await first.recording(tmp_path)
    for n in range(6):
        judges[n % 2].put(task(n))
        first.left(n % 2)
        if n + 1 == written:
            await kept.close()  # what follows is in no file
    if not written:
        await kept.close()
        await asyncio.to_thread(shutil.rmtree, tmp_path)
    second = Telling(shared, restarts=1)
    again = await second.recording(tmp_path, task(6))
    judges[1].put(task(7))
    for judge in (1, 0):
        second.left(judge)
    await again.close()
    assert numbered_in(tmp_path)["task"] == [(n, task(n)) for n in range(8)]


async def test_a_series_is_gone_on_with_though_its_last_message_is_long_ago(tmp_path: Path, shared: Shared) -> None:
    judge, first = ItemWriter(shared.results[0]), Telling(shared)
    kept = await first.recording(tmp_path)
    judge.put(task(0))
    first.left()
    for n in range(10):  # 2 s each
        kept.put(batch_of(1000 * n, 1))
        await asyncio.to_thread(kept.flush, PATIENCE)
    await kept.close()
    again = await Telling(shared, restarts=1).recording(tmp_path)
    await again.close()
    assert numbered_in(tmp_path)["task"] == [(0, task(0))]


async def test_a_disk_that_stays_full_fills_no_memory_with_positions(
    tmp_path: Path, shared: Shared, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Files, "write", lambda *_: None)
    raw, telling = ItemWriter(shared.raw), Telling(shared)
    kept = await telling.recording(tmp_path)
    kept.settings = kept.settings.model_copy(update={"queue": 1.0})  # takes one item
    for n in range(50):
        raw.put(batch_of(n, 1))
        assert telling._drain(telling._raw) == 1
    telling._settle()
    assert kept.progress() == (1, 0) and shared.raw.position(TELL) == 0, "nothing is in a file"
    assert len(telling._raw.checkpoints) == 1
    monkeypatch.undo()
    await kept.close()
    telling._settle()
    assert shared.raw.position(TELL) == shared.raw.head, "the others were refused and counted"


async def test_a_fault_of_the_check_of_health_leaves_the_record_whole(
    tmp_path: Path, shared: Shared, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setattr(_Telling, "_look", lambda _: {}["figures"])
    monkeypatch.setattr(tell, "settle_memory", lambda: None)
    ItemWriter(shared.raw).put(batch_of(0, 5))
    for ring in (shared.raw, shared.frames):
        ring.end()
    config = replace(CONFIG, record=RecordSettings(folder=tmp_path))
    supervisor, control = Pipe()
    with supervisor, control:
        await _Telling(Assignment(shared, config, 1, control)).run()
    recording = Recording.open(tmp_path)
    assert sum(len(batch) for batch in recording.entries()) == 5 and not recording.unfinished
    assert "the check of the cell's health failed" in caplog.text
