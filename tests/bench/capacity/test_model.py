"""The arithmetic of capacity against numbers made by hand."""

from __future__ import annotations

import pytest
from capacity.model import (
    Cost,
    Forwarding,
    Lake,
    Load,
    Prices,
    Reading,
    Traffic,
    fitted,
    most_cells,
    puts,
    stored_gb_months,
    year,
)

COSTS = Forwarding(message_in=20e-6, message_out=30e-6, mb_in=1e-3, mb_out=2e-3)
PRICES = Prices(gb_month=0.02, puts_1000=0.005, gets_1000=0.0004, egress_gb=0.09, core_hour=0.05)


def test_cores_of_a_router_are_those_of_messages_and_of_bytes() -> None:
    # 1000 messages a second in and two times out: 0.02 + 2 * 0.03; 5 MB/s: 5 * (0.001 + 2 * 0.002).
    assert COSTS.cores(Traffic(1000, 5e6), 2) == pytest.approx(0.08 + 0.025)


def test_what_nobody_wants_does_not_reach_the_router() -> None:
    assert COSTS.cores(Traffic(1000, 5e6), 0) == 0


def test_traffic_adds_up() -> None:
    assert Traffic(1, 10) + Traffic(2, 5) == Traffic(3, 15)


def test_costs_are_found_again_in_loads_that_they_make() -> None:
    loads = [
        Load(Traffic(n, n * size), readers, n * (20e-6 + readers * 30e-6) + n * size / 1e6 * (1e-3 + readers * 2e-3))
        for n in (1000, 1600)
        for size in (300, 30_000)
        for readers in (1, 3)
    ]
    found = fitted(loads)
    assert found.message_in == pytest.approx(20e-6)
    assert found.message_out == pytest.approx(30e-6)
    assert found.mb_in == pytest.approx(1e-3)
    assert found.mb_out == pytest.approx(2e-3)


def test_no_cost_is_negative_where_the_loads_say_so() -> None:
    # Larger messages took less: noise, not a cost below zero.
    loads = [Load(Traffic(1000, 1000 * size), n, 0.1 - size * 1e-6) for size in (300, 30_000) for n in (1, 3)]
    assert min(vars_of(fitted(loads))) >= 0


def vars_of(costs: Forwarding) -> list[float]:
    return [costs.message_in, costs.message_out, costs.mb_in, costs.mb_out]


def test_too_few_loads_are_refused() -> None:
    with pytest.raises(ValueError, match="found 3 loads, expected at least four"):
        fitted([Load(Traffic(1, 1), 1, 1.0)] * 3)


@pytest.mark.parametrize(
    ("a_cell", "cores", "headroom", "cells"),
    [(0.05, 1, 0.5, 10), (0.051, 1, 0.5, 9), (0.05, 4, 0.5, 40), (0.05, 1, 0.0, 20), (0.6, 1, 0.5, 0)],
)
def test_cells_fit_within_the_headroom(a_cell: float, cores: float, headroom: float, cells: int) -> None:
    assert most_cells(a_cell, cores, headroom) == cells


@pytest.mark.parametrize(("a_cell", "headroom"), [(0.0, 0.5), (0.1, 1.0), (0.1, -0.1)])
def test_cells_without_a_cost_or_a_core_are_refused(a_cell: float, headroom: float) -> None:
    with pytest.raises(ValueError, match="cores a cell and headroom"):
        most_cells(a_cell, headroom=headroom)


@pytest.mark.parametrize(("size", "requests"), [(1, 1), (10_485_760, 1), (10_485_761, 4), (41e6, 6)])
def test_a_large_file_is_uploaded_in_parts(size: float, requests: int) -> None:
    assert puts(size) == requests


def test_requests_of_a_day_without_joining() -> None:
    lake = Lake(bytes=144 * 300e3, files=144)
    assert (lake.writing, lake.joining, lake.kept) == (144, 0, 144)


def test_requests_of_a_day_that_is_joined() -> None:
    # Written: 144. Joined: 43.2 MB in five parts and two more, two lists, 144 marks of the folder.
    # Read back: 144 files twice, with three requests each, and looked for once before they are removed.
    lake = Lake(bytes=144 * 300e3, files=144, compact=True)
    assert (lake.writing, lake.joining, lake.kept) == (144 + 7 + 2 + 144, 144 * 7, 1)


def test_a_first_year_stores_half_of_what_the_next_ones_do() -> None:
    # 1000 cells with 0.1 GB a day: 36,500 GB after a year; on average half of that over twelve months.
    lake = Lake(bytes=0.1e9, files=144)
    assert stored_gb_months(1000, lake) == pytest.approx(36_500 / 2 * 12)
    assert stored_gb_months(1000, lake, age_days=365) == pytest.approx(36_500 * 12)


def test_a_lake_that_keeps_little_is_full_soon() -> None:
    # 73 days are a fifth of the year: growing for a fifth, full for four.
    lake = Lake(bytes=1e9, files=1)
    assert stored_gb_months(1, lake, kept_days=73) == pytest.approx(73 * 12 * (0.2 / 2 + 0.8))


def test_a_lake_that_keeps_longer_than_a_year_goes_on_growing() -> None:
    # The second of two years: from 365 to 730 GB, 547.5 on average.
    assert stored_gb_months(1, Lake(1e9, 1), kept_days=730, age_days=365) == pytest.approx(547.5 * 12)


def test_the_cost_of_a_year() -> None:
    lake = Lake(bytes=0.1e9, files=100)
    reading = Reading(cell_days=50, share=0.1, gets_a_file=3, outside=0.5, core_hours=0.01)
    cost = year(1000, lake, reading, PRICES)
    assert cost.storage == pytest.approx(219_000 * 0.02)
    assert cost.put == pytest.approx(1000 * 100 * 365 / 1000 * 0.005)  # 36.5 million
    assert cost.get == pytest.approx(50 * 365 * 100 * 3 / 1000 * 0.0004)
    assert cost.egress == pytest.approx(50 * 365 * 0.1 * 0.1 * 0.5 * 0.09)
    assert cost.compute == pytest.approx(1000 * 0.01 * 365 * 0.05)
    assert cost.total == pytest.approx(4380 + 182.5 + 2.19 + 8.2125 + 182.5)


def test_all_costs_are_in_the_total() -> None:
    assert Cost(1, 10, 100, 1000, 10_000).total == 11_111
