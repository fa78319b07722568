"""Figures as Markdown."""

from __future__ import annotations

import pytest
from capacity.figures import repeated
from capacity.page import said, table
from capacity.router import ARM, traffic_of


def test_a_figure_has_its_spread() -> None:
    runs = iter([{"s": 3.0}, {"s": 1.0}, {"s": 20.0}])
    assert said(repeated(lambda: next(runs), 3)["s"]) == "3.0 (1.0 … 20)"


def test_runs_that_agree_have_one_figure() -> None:
    assert said({"median": 1234.0, "least": 1234.0, "most": 1234.0}) == "1,234"


@pytest.mark.parametrize(("share", "text"), [(0.00123, "0.12"), (0.0, "0.0"), (0.4567, "46"), (0.0456, "4.6")])
def test_small_figures_keep_two_digits(share: float, text: str) -> None:
    assert said({"median": share, "least": share, "most": share}, 100) == text


def test_a_table_has_a_line_for_each_row() -> None:
    assert table(["a", "b"], [["1", "2"]]) == "| a | b |\n| --- | --- |\n| 1 | 2 |"


def test_traffic_is_that_of_the_topics_that_are_wanted() -> None:
    frames = traffic_of(ARM, "frames, results, health")
    assert frames.messages == pytest.approx(55)
    assert frames.bytes == pytest.approx(50 * 5384 + 4 * 605 + 3674)
    assert traffic_of(ARM, "everything").messages == pytest.approx(55 + 623)
    assert traffic_of(ARM, "nothing").messages == 0
