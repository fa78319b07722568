"""The tables of bench/outlets.py, from figures made up for the test."""

from __future__ import annotations

import pytest
from outlet.blocked import DELIVERED, WAYS, lost
from outlet.figures import spread
from outlet.page import TEXTS, markdown, said
from outlet.turns import in_turn


def figure(median: float, least: float | None = None, most: float | None = None):
    return {"median": median, "least": median if least is None else least, "most": median if most is None else most}


def test_ways_are_taken_in_turn() -> None:
    order: list[str] = []

    def way(name: str, value: float):
        order.append(name)
        return {"s": value + len(order)}

    found = in_turn({"a": lambda: way("a", 10.0), "b": lambda: way("b", 20.0)}, 3)
    assert order == ["a", "b"] * 3
    assert found == {"a": {"s": figure(13.0, 11.0, 15.0)}, "b": {"s": figure(24.0, 22.0, 26.0)}}


def test_throughput_is_beside_the_library_with_loss_and_processor_time() -> None:
    opc_ua = {
        f"{way}_{pace}": {"values_per_s": figure(3000.0), "lost": figure(0.25), "core_percent": figure(33.0, 30.0, 40)}
        for way in ("cellwatt", "plain")
        for pace in ("at_50_hz", "as_fast", "at_500_hz")
    }
    metrics = {"answers_per_s": figure(1466.0), "plain_answers_per_s": figure(131.0), "series": figure(300.0)}
    lines = markdown({"metrics": metrics, "opc_ua": opc_ua}).splitlines()
    assert lines[2] == "| metrics, answers | cellwatt | 1,466 | – | – |"
    assert lines[3] == "| metrics, answers | prometheus-client | 131 | – | – |"
    assert lines[5] == "| OPC UA, values, 50 rows/s | asyncua | 3,000 | 25 | 33 (30 … 40) |"
    assert len(lines) == 2 + 2 + 6


def test_what_was_not_measured_is_told() -> None:
    text = markdown({"mqtt": {"not measured": "no broker"}, "blocked": {"not measured": "no broker"}})
    assert "| mqtt | not measured: no broker | – | – | – |" in text
    assert text.endswith("blocked: not measured: no broker")


def test_a_daemons_figures_have_a_column_for_each_way() -> None:
    figures = {name: figure(1.5) for name in TEXTS} | {"tell_percent": figure(17.0, 15.0, 19.0)}
    lines = markdown({"blocked": dict.fromkeys(WAYS, figures)}).splitlines()
    assert lines[0] == "|  | alone | blocked | answering |"
    assert lines[-1] == "| `tell`, % of a core |" + 3 * " 17 (15 … 19) |"
    assert {f"{name}_delivered" for name in DELIVERED} < set(TEXTS)


def test_losses_are_those_between_two_looks_at_the_devices() -> None:
    def health(arm_dropped: int, arm_missed: int, absent: int, unrecorded: int):
        return {
            "sources": {
                "arm": {"dropped": {"ring": arm_dropped}, "missed": {"gap": arm_missed, "poll": 1}},
                "absent": {"dropped": {}, "missed": {"poll": absent}},
            },
            "recorder": {"drops": {"/raw/arm/rtde": unrecorded}},
        }

    found = lost(health(1, 2, 0, 5), health(4, 9, 100, 6), ["arm"])
    assert found == {"lost": 3.0, "missed": 7.0, "unrecorded": 1.0}


@pytest.mark.parametrize(
    ("runs", "factor", "text"),
    [([3.0, 1.0, 20.0], 1, "3.0 (1.0 … 20)"), ([1234.0], 1, "1,234"), ([0.00123], 100, "0.12"), ([0.0], 100, "0.0")],
)
def test_a_figure_has_its_spread_and_two_digits(runs: list[float], factor: float, text: str) -> None:
    assert said(spread([{"s": s} for s in runs])["s"], factor) == text
