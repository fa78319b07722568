"""Power and energy of a cell in its health: against sums made by hand, over midnight and over a restart."""

from __future__ import annotations

import asyncio
import time
from pathlib import Path

import numpy as np
import pytest

from cellwatt import Energy, FrameChannel, Frames, Layout
from cellwatt.runtime.consumption import FILE, Consumption
from tests.blocks import frames_of

STEP = 20_000_000
NOON = 1_790_000_000_000_000_000 // 86_400_000_000_000 * 86_400_000_000_000 + 43_200_000_000_000


def layout(*names: str) -> Layout:
    return Layout(tuple(FrameChannel(name, "W", "continuous", "mean") for name in names), 50.0)


def block(columns: Layout, values: list[list[float]], start: int = NOON, sequence: int = 0) -> Frames:
    return frames_of(columns, sequence, start + STEP * np.arange(len(values)), np.array(values, float))


@pytest.fixture(autouse=True)
def _utc(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()


def test_all_supplies_count_and_no_bus_beside_them() -> None:
    cell = Consumption()
    columns = layout("board.supply.power", "mains.supply.power", "board.bus.power")
    cell.add(block(columns, [[100.0, 50.0, 70.0]] * 100))
    assert cell.status() == {"power_W": 150.0, "energy_today_J": 150.0 * 100 * 0.02}


def test_without_a_supply_the_bus_counts_and_without_both_nothing_is_told() -> None:
    bus, none = Consumption(), Consumption()
    bus.add(block(layout("board.bus.power"), [[80.0]] * 50))
    none.add(block(layout("arm.joint_1.power"), [[80.0]] * 50))
    assert bus.status() == {"power_W": 80.0, "energy_today_J": 80.0}
    assert none.status() == {"power_W": None, "energy_today_J": None}


def test_power_is_the_mean_of_the_last_second_and_what_is_missing_counts_as_none() -> None:
    cell = Consumption()
    columns = layout("board.supply.power")
    cell.add(block(columns, [[10.0]] * 50 + [[np.nan]] * 25 + [[30.0]] * 25))
    assert cell.status() == {"power_W": 15.0, "energy_today_J": 10.0 + 15.0}
    cell.add(block(columns, [[np.nan]] * 50, NOON + 100 * STEP))
    assert cell.status() == {"power_W": None, "energy_today_J": 10.0 + 15.0}, "the meter is silent, not at 0 W"


def test_at_midnight_it_begins_anew() -> None:
    cell = Consumption()
    midnight = NOON + 43_200_000_000_000
    cell.add(block(layout("board.supply.power"), [[10.0]] * 150, start=midnight - 50 * STEP))
    assert cell.status()["energy_today_J"] == pytest.approx(10.0 * 100 * 0.02)


async def test_after_a_restart_it_goes_on(tmp_path: Path) -> None:
    first, second = Consumption(), Consumption()
    columns = layout("board.supply.power")
    first.add(block(columns, [[10.0]] * 50))
    await first.write(tmp_path)
    await asyncio.to_thread(second.read, tmp_path, NOON + 50 * STEP)
    second.add(block(columns, [[10.0]] * 100))  # the first fifty are those that were counted
    assert second.status()["energy_today_J"] == 20.0


async def test_a_clock_that_was_set_back_by_a_year_stops_nothing(tmp_path: Path) -> None:
    first, second = Consumption(), Consumption()
    columns = layout("board.supply.power")
    first.add(block(columns, [[10.0]] * 50, start=NOON + 365 * 86_400 * 10**9))
    await first.write(tmp_path)
    await asyncio.to_thread(second.read, tmp_path, NOON)
    second.add(block(columns, [[30.0]] * 50))
    assert second.status() == {"power_W": 30.0, "energy_today_J": 30.0}


async def test_a_cell_that_rests_writes_nothing(tmp_path: Path) -> None:
    cell = Consumption()
    cell.add(block(layout("board.supply.power"), [[10.0]] * 50))
    await cell.write(tmp_path)
    (tmp_path / FILE).unlink()
    await cell.write(tmp_path)
    assert not (tmp_path / FILE).exists()


@pytest.mark.parametrize("text", ["", "[]", '{"day": "yesterday"}'])
async def test_a_damaged_file_is_told(tmp_path: Path, caplog: pytest.LogCaptureFixture, text: str) -> None:
    (tmp_path / FILE).write_text(text)
    cell = Consumption()
    await asyncio.to_thread(cell.read, tmp_path, NOON)
    assert "energy.json cannot be read" in caplog.text
    await cell.write(tmp_path)
    assert (tmp_path / FILE).read_text() == text, "nothing was measured"


def test_without_a_measured_channel_the_energies_of_tasks_of_today_count() -> None:
    cell, measured = Consumption(), Consumption()
    measured.add(block(layout("board.supply.power"), [[10.0]] * 50))
    for hour, joule in ((0, 100.0), (1, float("nan")), (2, 20.0)):
        end = NOON + hour * 3600 * 10**9
        for told in (cell, measured):
            told.end(Energy("arm", "task_1", "v", 1, end - 1, end, joule, {}, 1.0, 1.0, 1.0))
    assert (cell.status()["energy_today_J"], cell.task) == (120.0, "task_1")
    assert (measured.status()["energy_today_J"], measured.task) == (10.0, "task_1")
    cell.add(block(layout("arm.joint_1.power"), [[80.0]], NOON + 13 * 3600 * 10**9))
    assert cell.status()["energy_today_J"] == 0.0, "midnight has passed"
