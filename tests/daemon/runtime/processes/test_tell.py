"""The process that tells: alarms whose judge died are not left active, nor withdrawn twice."""

from __future__ import annotations

from dataclasses import replace
from multiprocessing import Pipe

from cellwatt.ring import ItemWriter, Status
from cellwatt.runtime.assemble import declared
from cellwatt.runtime.processes.resume import Resume
from cellwatt.runtime.processes.shared import Assignment, Shared
from cellwatt.runtime.processes.tell import _Telling
from tests.daemon.runtime.fakes import alarm, config_of, stages

CONFIG = config_of(stages=stages("heat"), sinks={})
BEGUN = Status({"begun": ["heat"]})


class Telling(_Telling):
    """A process that tells, begun by hand; ``left`` are the ids of the alarms that it takes for active."""

    def __init__(self, shared: Shared) -> None:
        super().__init__(Assignment(shared, CONFIG, 1, Pipe()[1]))
        self._resume = Resume()

    def left(self, judge: int = 0) -> list[str]:
        self._drain(self._results[judge])
        return [standing.alarm.id for standing in self._teller.alarms.raised]


def test_a_judge_that_begins_ends_the_alarms_of_the_one_that_died() -> None:
    shared = Shared.of(*declared(CONFIG))
    said, telling = ItemWriter(shared.results[0]), Telling(shared)
    said.put(alarm("a", stage="heat"))
    said.put(alarm("b", stage="noise"))
    assert telling.left() == ["a", "b"]
    said.put(BEGUN)
    said.put(replace(alarm("c", stage="heat"), time=9))
    assert telling.left() == ["b", "c"]


def test_who_tells_next_does_not_withdraw_what_was_raised_since() -> None:
    shared = Shared.of(*declared(CONFIG))
    said, first = ItemWriter(shared.results[0]), Telling(shared)
    for item in (BEGUN, alarm("a", stage="heat")):
        said.put(item)
    assert first.left() == ["a"]
    first._teller.journal.put(alarm("a", stage="heat"))  # type: ignore[union-attr]
    assert Telling(shared).left() == ["a"]


def test_a_judge_in_another_place_ends_the_alarms_of_one_that_was_down_at_a_reload() -> None:
    shared = Shared.of(*declared(CONFIG))
    telling = Telling(shared)
    ItemWriter(shared.results[0]).put(alarm("a", stage="heat"))
    assert telling.left() == ["a"]
    ItemWriter(shared.results[1]).put(BEGUN)
    assert telling.left(1) == []
