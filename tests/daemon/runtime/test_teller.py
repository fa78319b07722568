"""Alarms on their way to the outlets: those of stages that are gone, those that flap, those on the shelf."""

from __future__ import annotations

import asyncio
from dataclasses import replace
from typing import Any

import pytest

from cellwatt import Alarm, Event, Layout, Task
from cellwatt.config import CellConfig
from cellwatt.ring import Ring, RingJournal
from cellwatt.runtime.tasks import Tasks
from cellwatt.runtime.teller import Teller
from tests.daemon.outlets.zenoh.fake_cell import task
from tests.daemon.runtime.at_once import at_once
from tests.daemon.runtime.fakes import alarm, config_of, outlets, stages

SECOND = 10**9
CONFIG = config_of(sources={}, outlets={}, stages=stages("heat", "noise"))


class Told(Teller):
    """Teller that keeps what its outlets and its record would get; ``time`` is the cell's clock."""

    def __init__(self, config: CellConfig = CONFIG, journal: Any = None) -> None:
        self.time = 0
        self.offered: list[Any] = []
        self.recorded: list[Any] = []
        self.numbers: list[int | None] = []
        super().__init__(config, 1, lambda: self.time, journal)

    def _offer(self, item: Any) -> None:
        self.offered.append(item)

    def record(self, item: Any, number: int | None = None) -> None:
        self.recorded.append(item)
        self.numbers.append(number)

    def looked_at(self) -> list[str]:
        """Ids of the alarms in health after a look."""
        self.look({"sources": {}, "stages": {}})
        return [a["id"] for a in self.status()["alarms"]]


def changes(alarms: list[Alarm]) -> list[tuple[str, bool]]:
    return [(a.id, a.active) for a in alarms]


def test_alarms_of_stages_that_begin_anew_or_were_removed_are_withdrawn_and_no_others() -> None:
    teller = Told()
    for item in (alarm("a", stage="heat"), alarm("b", stage="noise"), alarm("c")):
        teller.take(item)
    teller.time = 7
    teller.withdraw(["heat"], "restarts")
    over = teller.offered[-1]
    assert (over.id, over.active, over.time) == ("a", False, 7)
    assert over.statement == "Withdrawn, as stage heat restarts: Joint 2: a."
    assert teller.recorded[-1] == over
    assert teller.looked_at() == ["b", "c"]
    teller.change(None, replace(CONFIG, stages=stages("heat")), [])  # type: ignore[arg-type]
    assert changes(teller.offered[4:]) == [("b", False)]
    assert teller.offered[-1].statement == "Withdrawn, as stage noise is no longer part of the cell: Joint 2: b."


def test_an_alarm_that_comes_and_goes_is_published_a_few_times_and_recorded_each_time() -> None:
    teller = Told()
    for n in range(40):
        teller.time = n * 10 * SECOND
        teller.take(replace(alarm("a", active=n % 2 == 0), time=teller.time))
        teller.look({"sources": {}, "stages": {}})
    assert len(teller.recorded) == 40
    assert changes(teller.offered) == [("a", True), ("a", False)] * 5 + [("a", True)] * 2
    assert "The condition comes and goes" in teller.offered[-1].statement
    assert teller.looked_at() == ["a"]
    teller.time += 600 * SECOND
    assert teller.looked_at() == []
    assert (teller.offered[-1].active, teller.offered[-1].evidence["flaps"]) == (False, 15)


@pytest.mark.parametrize("active", [True, False])
def test_only_news_is_logged(caplog: pytest.LogCaptureFixture, active: bool) -> None:
    teller = Told(replace(CONFIG, outlets=outlets()))
    teller.take(alarm("a"))
    teller.take(replace(alarm("a", active=active), time=9))
    assert len(caplog.records) == 1 + (not active)


def test_a_result_is_recorded_under_the_number_that_it_is_told_with() -> None:
    journal = RingJournal(Ring(1 << 16, 1), Ring(1 << 16, 1))
    teller = Told(journal=journal)
    given = [task(0), Event(1, None, "reloaded", ""), alarm("a"), task(1)]
    for item in given:
        teller.take(item)
    assert teller.numbers == [0, 0, None, 1]
    assert [(n, item) for n, item in journal.past() if isinstance(item, Task)] == [(0, task(0)), (1, task(1))]


def test_the_next_process_knows_the_alarms_also_when_the_journal_has_overwritten_their_messages() -> None:
    rings = Ring(1 << 16, 1), Ring(1 << 16, 1)
    first = Teller(CONFIG, 1, lambda: 0, RingJournal(*rings))
    first.take(alarm("a", stage="heat"))
    first.acknowledge("a", "Ines", "gone soon")
    first.take(alarm("a", active=False, stage="heat"))
    for item in (alarm("a", stage="heat"), alarm("b", stage="noise")):
        first.take(item)
    first.acknowledge("b", "Omar", "known")
    for known in (True, False, False):
        journal = RingJournal(*rings)
        assert any(isinstance(item, Alarm) for _, item in journal.past()) == known
        successor = Told(journal=journal)
        assert successor.looked_at() == ["a", "b"]
        names = [a["acknowledged"] and a["acknowledged"]["name"] for a in successor.status()["alarms"]]
        assert names == [None, "Omar"], "a was over after Ines acknowledged it"
        for n in range(1000):
            successor.take(Event(n, None, "reloaded", 20 * "again "))
    successor.withdraw(["heat"], "restarts")
    assert changes(successor.offered[-1:]) == [("a", False)]


@at_once
async def test_a_warning_that_time_brings_is_in_health(monkeypatch: pytest.MonkeyPatch) -> None:
    teller = Told()
    async with asyncio.TaskGroup() as group:
        tasks = Tasks(group)
        await teller.start(tasks, {}, Layout((), 50.0))
        monkeypatch.setattr(CellConfig, "warnings", ("page: certificate: cert.pem ended",))
        await asyncio.sleep(2 * 3600)
        teller.looked_at()
        assert teller.status()["warnings"] == CellConfig.warnings
        await teller.close(tasks)
