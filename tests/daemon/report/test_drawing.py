"""Traces of figures: thinned and rounded so that nothing seen is lost."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from cellwatt.report.drawing import curve, dots, plain, thin


@given(st.lists(st.floats(-1e6, 1e6) | st.just(float("nan")), max_size=400), st.integers(4, 60))
def test_thinning_keeps_extremes_and_gaps(values: list[float], most: int) -> None:
    given_values = np.array(values, np.float64)
    kept, apart = thin(given_values, most)
    assert len(kept) <= most or len(kept) == len(given_values)
    known, left = given_values[np.isfinite(given_values)], kept[np.isfinite(kept)]
    assert set(left) <= set(known)
    assert len(known) == 0 or (left.min(), left.max()) == (known.min(), known.max())
    assert len(kept) * apart >= len(given_values)


def test_thinning_keeps_a_peak_at_its_place() -> None:
    values = 9.0 * (np.arange(10_000) == 7321)
    kept, apart = thin(values, 1000)
    assert abs(int(np.argmax(kept)) * apart - 7321) <= apart * 2


def test_rounding_keeps_a_part_of_the_range_that_no_eye_sees() -> None:
    values = np.linspace(-3.0, 7.0, 999)
    assert np.abs(np.array(plain(values)) - values).max() <= 10.0 / 5000
    assert plain([1.0, np.nan, np.inf]) == [1.0, None, None]
    assert plain([]) == []


def test_a_curve_says_where_its_points_lie() -> None:
    drawn = curve("<b>", np.arange(100.0), "#000000", start=2.0, step=0.5, most=20)
    assert (drawn["name"], drawn["x0"], drawn["dx"]) == ("&lt;b&gt;", 2.0, 0.5 * 10 / 2)
    assert (min(drawn["y"]), max(drawn["y"])) == (0.0, 99.0)


def test_of_many_dots_a_part_is_drawn_and_gaps_are_not() -> None:
    y = np.where(np.arange(9000) % 3 == 0, np.nan, 1.0)
    drawn = dots("", np.arange(9000.0), y, "#000000")
    assert len(drawn["x"]) == len(drawn["y"]) == 2000
    assert all(x % 3 for x in drawn["x"])
