"""What is done before devices are read, and while none of them speaks."""

from __future__ import annotations

import asyncio
import sys
import time

import pytest

from cellwatt.batch import Batch, Tick
from cellwatt.clock.cell import CellClock
from cellwatt.runtime import collector
from cellwatt.runtime.collector import Collector, Entry, load_libraries
from cellwatt.runtime.tasks import Tasks
from tests.daemon.runtime.fakes import DEVICES, FakeDriver, answer, config_of, give, sources, until


def test_libraries_of_drivers_are_loaded_and_missing_ones_left_to_the_driver(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(FakeDriver, "libraries", ("not_there.at_all", "wave"), raising=False)
    monkeypatch.delitem(sys.modules, "wave", raising=False)
    load_libraries(config_of(sources=sources("arm")))
    assert "wave" in sys.modules


async def test_ticks_end_where_no_source_speaks_for_long_and_go_on_with_the_next_sample(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(collector, "RESTS", 0.3)
    came: list[tuple[float, Entry]] = []
    cell = Collector(
        config_of(sources=sources("arm")), CellClock(), lambda entry: came.append((time.monotonic(), entry))
    )

    def last() -> Entry | None:
        return came[-1][1] if came else None

    async with asyncio.TaskGroup() as group:
        tasks = Tasks(group)
        cell.start(tasks)
        for n in (1, 2):
            DEVICES["arm"].tell(answer, give(1))
            await DEVICES["arm"].done()
            await until(lambda: isinstance(last(), Tick))
            await until(lambda: time.monotonic() - came[-1][0] > 0.6)
            assert sum(isinstance(entry, Batch) for _, entry in came) == n
        await cell.close(tasks)
