"""What is done before devices are read, and while none of them speaks."""

from __future__ import annotations

import asyncio
import sys
import time
from pathlib import Path

import pytest

from cellwatt.batch import Batch, Tick
from cellwatt.clock.cell import CellClock
from cellwatt.config import FrameSettings
from cellwatt.runtime import collector
from cellwatt.runtime.collector import Collector, Entry, load_libraries
from cellwatt.runtime.tasks import Tasks
from tests.daemon.runtime.at_once import at_once
from tests.daemon.runtime.fakes import DEVICES, FakeDriver, answer, config_of, give, sources, until


def test_libraries_of_drivers_are_loaded_and_missing_or_broken_ones_left_to_the_driver(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "broken_library.py").write_text("raise OSError('libusb.so.1: cannot open shared object file')")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(FakeDriver, "libraries", ("not_there.at_all", "broken_library", "wave"), raising=False)
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


@at_once
async def test_ticks_come_as_often_as_frames_of_new_settings() -> None:
    came: list[Entry] = []
    slow, fast = (config_of(frames=FrameSettings(rate=rate)) for rate in (10.0, 50.0))
    cell = Collector(slow, CellClock(), came.append)
    async with asyncio.TaskGroup() as group:
        tasks = Tasks(group)
        cell.start(tasks)
        DEVICES["arm"].tell(answer, give(1))
        await DEVICES["arm"].done()
        ticks = []
        for config in (slow, fast):
            cell.change(tasks, config, [])
            before = len(came)
            await asyncio.sleep(2.0)
            ticks.append(len(came) - before)
        await cell.close(tasks)
    assert 15 < ticks[0] < 25 and ticks[1] > 2 * ticks[0]
