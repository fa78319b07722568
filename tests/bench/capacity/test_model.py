"""The arithmetic of capacity against numbers made by hand."""

from __future__ import annotations

import pytest
from capacity.model import Forwarding, Load, Traffic, fitted, most_cells

COSTS = Forwarding(message_in=20e-6, message_out=30e-6, mb_in=1e-3, mb_out=2e-3)


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
