import numpy as np

from cellwatt.live.sparkline import BARS, bars, parts


def test_parts_are_means_and_nothing_where_nothing_is_known() -> None:
    time = np.array([0, 1, 2, 3, 6, 7])
    values = np.array([1.0, 3.0, np.nan, 5.0, 8.0, 10.0])
    assert parts(time, values, 0, 7, 4).tolist()[:2] == [2.0, 5.0]
    assert np.isnan(parts(time, values, 0, 7, 4)[2])
    assert parts(time, values, 0, 7, 4)[3] == 9.0


def test_values_outside_the_span_do_not_count() -> None:
    assert parts(np.array([-5, 0, 99]), np.array([7.0, 1.0, 7.0]), 0, 9, 2)[0] == 1.0


def test_the_least_is_the_lowest_bar_and_the_most_the_highest() -> None:
    assert bars([1.0, 8.0, float("nan"), 4.5], 1.0, 8.0) == f"{BARS[0]}{BARS[7]} {BARS[4]}"


def test_a_course_without_change_is_drawn() -> None:
    assert bars([3.0, 3.0], 3.0, 3.0) == BARS[0] * 2
