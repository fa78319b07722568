"""Which packs are made, when, and what becomes of those that cannot be."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from cellwatt import Alarm, Event
from cellwatt.errors import CellwattError
from cellwatt.record import Recording, RecordSettings, packs
from cellwatt.record.cut import cut
from cellwatt.record.header import PART
from cellwatt.record.settings import EvidenceSettings
from cellwatt.runtime.evidence import keeper as keeping
from cellwatt.runtime.evidence.keeper import Keeper
from tests.daemon.record.making import CELL, PERIOD, SESSION, batch_of, frames_of, write_chunks
from tests.patience import PATIENCE, eventually

S = 10**9
EVIDENCE = EvidenceSettings(before=2.0, after=1.0)


def alarm(name: str = "faults.arm.joint_fault.2", at: float = 5.0, **more: Any) -> Alarm:
    time = SESSION + round(at * S)
    told = {"kind": "joint_fault", "severity": "error", "active": True, "statement": "Joint 2 needs 38 W more", **more}
    return Alarm(id=name, since=time, time=time, source="arm", joint=2, **told)


class Cell:
    """A record of 10 s, a clock that is set by hand, and a keeper that makes packs without a process of their own."""

    def __init__(self, folder: Path) -> None:
        self.time = 0.0
        self.events: list[Event] = []
        self.settings = RecordSettings(folder=folder, evidence=EVIDENCE)
        self.folder = folder / packs.FOLDER
        write_chunks(folder, [[batch_of(50 * i, 50), frames_of(5 * i, 5)] for i in range(100)])

    @asynccontextmanager
    async def keeper(self, *, by_process: bool = False, **more: Any) -> AsyncIterator[Keeper]:
        keeper = Keeper(self.settings, CELL, lambda: SESSION + round(self.time * S), self.events.append, **more)
        if not by_process:
            keeper._made_by_process = self.make  # type: ignore[method-assign]
        task = asyncio.create_task(keeper.run())
        try:
            yield keeper
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    async def make(self, due: packs.Due) -> dict[str, Any]:
        pack = self.folder / f"{due.name}.mcap"
        await asyncio.to_thread(cut, self.settings.folder, due.cell, due.start, due.end, pack)
        return {"problem": ""}

    @property
    def packs(self) -> list[Path]:
        return sorted(self.folder.glob("*.mcap"))

    @property
    def due(self) -> list[Path]:
        return sorted(self.folder.glob(f"*{packs.DUE}"))


@pytest.fixture
def cell(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Cell:
    monkeypatch.setattr(keeping, "LOOK", 0.01)
    monkeypatch.setattr(keeping, "CLOSE", PATIENCE)
    return Cell(tmp_path)


@pytest.mark.timeout(120)
async def test_a_process_cuts_the_pack_and_writes_its_page(cell: Cell) -> None:
    async with cell.keeper(by_process=True) as keeper:
        keeper.alarm(alarm())
        await eventually(lambda: cell.due, "the note on disk")
        cell.time = 5.9
        await asyncio.sleep(0)
        assert not cell.packs, "the time after the alarm is not over"
        cell.time = 7.0
        await eventually(lambda: cell.events, "the pack")
        await eventually(lambda: keeper.stats()["packs"] == 1, "the count")
    (event,), (pack,) = cell.events, cell.packs
    assert event.kind == "evidence" and event.source == "arm"
    assert event.data["alarms"] == ["faults.arm.joint_fault.2"] and event.data["pack"] == pack.name
    assert "faults.arm.joint_fault.2" in pack.name and f"stored in evidence/{pack.name}" in event.text
    recording = Recording.open(pack)
    sequence = recording.batches("arm", "rtde").sequence
    assert (sequence[0], sequence[-1], len(sequence)) == (3 * S // PERIOD, 6 * S // PERIOD, 1501)
    assert recording.header.settings == "site: plant-1\n"
    page = packs.page_of(pack).read_text()
    assert "Joint 2 needs 38 W more" in page and "<svg" in page and "id=plotly" not in page
    assert not cell.due
    stats = keeper.stats()
    assert (stats["made"], stats["waiting"], stats["given_up"], stats["problem"]) == (1, 0, 0, "")
    assert stats["bytes"] == pack.stat().st_size + packs.page_of(pack).stat().st_size


async def test_updates_of_an_alarm_and_alarms_of_little_weight_make_no_pack(cell: Cell) -> None:
    async with cell.keeper() as keeper:
        keeper.alarm(alarm("small", severity="info"))
        for n in range(5):
            keeper.alarm(replace(alarm(), time=SESSION + (5 + n) * S))
        cell.time = 20.0
        await eventually(lambda: cell.events, "the pack")
        await eventually(lambda: not cell.due, "the end")
        assert len(cell.packs) == 1
        # What is raised again after it was cleared is another matter, and so is one that becomes graver.
        keeper.alarm(alarm(active=False, at=8.0))
        keeper.alarm(alarm(at=9.0))
        keeper.alarm(alarm("small", severity="error", at=9.1))
        await eventually(lambda: len(cell.events) == 2, "the second pack")
    assert cell.events[-1].data["alarms"] == ["faults.arm.joint_fault.2", "small"]
    assert "faults.arm.joint_fault.2 and 1 more stored in" in cell.events[-1].text


async def test_a_pack_that_was_due_when_the_daemon_was_killed_is_made_by_the_next(cell: Cell) -> None:
    async with cell.keeper() as keeper:
        keeper.alarm(alarm())
        await eventually(lambda: cell.due, "the note on disk")
    cell.time = 100.0
    async with cell.keeper(known=[alarm()]) as keeper:
        keeper.alarm(alarm())  # still up: an update
        await eventually(lambda: cell.events, "the pack")
    assert len(cell.packs) == 1 and not cell.due


async def test_an_alarm_within_a_pack_that_is_being_made_gets_a_pack_of_its_own(cell: Cell) -> None:
    """An alarm has the time of its frames, which may be seconds old."""
    begun, go = asyncio.Event(), asyncio.Event()

    async def slow(due: packs.Due) -> dict[str, Any]:
        begun.set()
        await go.wait()
        return await cell.make(due)

    async with cell.keeper() as keeper:
        keeper._made_by_process = slow  # type: ignore[method-assign]
        keeper.alarm(alarm())
        cell.time = 7.0
        await eventually(begun.is_set, "the making")
        keeper.alarm(alarm("other", at=5.5))
        go.set()
        await eventually(lambda: len(cell.events) == 2, "two packs")
    assert [event.data["alarms"] for event in cell.events] == [["faults.arm.joint_fault.2"], ["other"]]
    assert len(cell.packs) == 2 and not cell.due


async def test_a_daemon_that_stops_early_makes_the_pack_with_what_there_is(cell: Cell) -> None:
    async with cell.keeper() as keeper:
        keeper.alarm(alarm(at=9.5))
        cell.time = 9.6
    await keeper.close()
    assert Recording.open(cell.packs[0]).end == SESSION + 4999 * PERIOD
    assert not cell.due and keeper.stats()["made"] == 1


async def test_a_stop_amid_the_first_note_leaves_a_note_of_each_pack(
    cell: Cell, monkeypatch: pytest.MonkeyPatch
) -> None:
    entered, written = asyncio.Event(), packs.write_due

    def slow(folder: Path, due: packs.Due) -> None:
        loop.call_soon_threadsafe(entered.set)
        written(folder, due)

    loop = asyncio.get_running_loop()
    monkeypatch.setattr(packs, "write_due", slow)
    async with cell.keeper() as keeper:
        keeper.alarm(alarm(at=5.0))
        keeper.alarm(alarm("other", at=60.0))
        await entered.wait()
    monkeypatch.setattr(keeping, "CLOSE", 0.0)
    await keeper.close()
    assert len(cell.due) == 2


async def test_what_is_gone_from_the_record_is_given_up_and_said(cell: Cell) -> None:
    async with cell.keeper() as keeper:
        keeper.alarm(alarm(at=50.0))
        cell.time = 60.0
        await eventually(lambda: cell.events, "the event")
    assert "not stored: " in cell.events[0].text and "nothing of cell weld-3 was recorded" in cell.events[0].text
    assert keeper.stats()["given_up"] == 1 and not cell.due and not cell.packs


async def test_a_disk_that_takes_no_note_gives_the_pack_up(cell: Cell) -> None:
    cell.folder.write_text("a file where the folder should be")
    async with cell.keeper() as keeper:
        keeper.alarm(alarm())
        await eventually(lambda: cell.events, "the event")
        assert keeper.stats()["given_up"] == 1 and keeper.stats()["waiting"] == 0
    assert "cannot be written" in cell.events[0].text


async def test_an_alarm_that_cannot_be_encoded_ends_no_keeper(cell: Cell) -> None:
    async with cell.keeper() as keeper:
        keeper.alarm(alarm("odd", statement="Stage x failed: no file \udcff"))
        await eventually(lambda: cell.events, "the event")
        keeper.alarm(alarm())
        cell.time = 60.0
        await eventually(lambda: len(cell.events) == 2, "the pack of the next alarm")
    assert "not stored: " in cell.events[0].text and len(cell.packs) == 1


@pytest.mark.timeout(120)
async def test_a_process_that_fails_says_why(cell: Cell) -> None:
    cell.settings = cell.settings.model_copy(update={"keep": 1e18, "file_size": 1e18})
    async with cell.keeper(by_process=True) as keeper:
        keeper.alarm(alarm())
        cell.time = 60.0
        await eventually(lambda: cell.events, "the event")
    assert "No space left on device" in cell.events[0].text and keeper.stats()["given_up"] == 1


async def test_a_pack_that_is_ended_amid_its_making_leaves_nothing(cell: Cell) -> None:
    async def ended(due: packs.Due) -> dict[str, Any]:
        (cell.folder / f"{due.name}.mcap{PART}").write_bytes(bytes(1000))
        raise CellwattError("it was ended by SIGKILL")

    async with cell.keeper() as keeper:
        keeper._made_by_process = ended  # type: ignore[method-assign]
        keeper.alarm(alarm())
        cell.time = 60.0
        await eventually(lambda: cell.events, "the event")
    assert "not stored: it was ended by SIGKILL" in cell.events[0].text
    assert not list(cell.folder.iterdir())


async def test_packs_beyond_the_budget_go_and_the_record_stays(cell: Cell) -> None:
    cell.settings = cell.settings.model_copy(update={"evidence": EVIDENCE.model_copy(update={"keep": 1.0})})
    record = sorted(cell.settings.folder.glob("*.mcap"))
    async with cell.keeper() as keeper:
        keeper.alarm(alarm())
        cell.time = 60.0
        await eventually(lambda: cell.events and not cell.packs, "the pack to come and go")
    assert sorted(cell.settings.folder.glob("*.mcap")) == record
