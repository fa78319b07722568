"""Charts as SVG."""

from __future__ import annotations

import re
from xml.etree import ElementTree

import pytest
from models.svg import BOTTOM, LEFT, RIGHT, SIZE, TOP, drawn

NAME = "{http://www.w3.org/2000/svg}"


def figure(*traces, **layout):
    return {"data": list(traces), "layout": layout}


def trace(x, y, mode="lines", name="one"):
    return {"x": x, "y": y, "mode": mode, "name": name}


def parsed(told):
    return ElementTree.fromstring(drawn(told))


def texts(root):
    return [element.text for element in root.iter(f"{NAME}text")]


def line_of(root):
    (line,) = root.iter(f"{NAME}polyline")
    return [tuple(map(float, point.split(","))) for point in line.attrib["points"].split()]


def test_a_line_goes_where_its_values_say():
    points = line_of(parsed(figure(trace([0, 5, 10], [0, 10, 0]))))
    (left, foot), (middle, top), (right, last) = points
    assert LEFT < left < middle < right < SIZE[0] - RIGHT
    assert TOP < top < foot == last < SIZE[1] - BOTTOM
    assert middle == pytest.approx((left + right) / 2)


def test_markers_are_drawn_only_where_wanted():
    plain, both, only = (parsed(figure(trace([1, 2], [3, 4], mode))) for mode in ("lines", "lines+markers", "markers"))
    assert [len(list(root.iter(f"{NAME}circle"))) for root in (plain, both, only)] == [0, 2, 2]
    assert [len(list(root.iter(f"{NAME}polyline"))) for root in (plain, both, only)] == [1, 1, 0]


def test_a_logarithmic_axis_has_equal_ways_for_equal_factors():
    root = parsed(figure(trace([1, 10, 100], [1, 2, 3]), xaxis={"type": "log", "tickvals": [1, 10, 100]}))
    (a, _), (b, _), (c, _) = line_of(root)
    assert b - a == pytest.approx(c - b, abs=0.11)  # to a tenth of a pixel, as written
    assert {"1", "10", "100"} <= set(texts(root))


def test_ticks_are_round_and_zero_has_no_sign():
    ticks = texts(parsed(figure(trace([-0.001, 9.0], [-12.0, 30.0]))))
    assert "-0" not in ticks
    assert {"0", "2", "4", "6", "8", "-10", "10", "20", "30"} <= set(ticks)


def test_titles_names_and_dotted_lines_are_there_and_safe():
    told = figure(
        trace([0, 1], [0, 1], name="a < b"),
        xaxis={"title": {"text": "way & time"}},
        yaxis={"title": {"text": "W"}},
        shapes=[{"x0": 0.5, "x1": 0.5}],
    )
    root = parsed(told)
    assert {"a < b", "way & time", "W"} <= set(texts(root))
    dotted = [line for line in root.iter(f"{NAME}line") if "stroke-dasharray" in line.attrib]
    (left, _), (right, _) = line_of(root)
    assert float(dotted[0].attrib["x1"]) == pytest.approx((left + right) / 2, abs=0.1)


def test_a_flat_line_is_drawn_too():
    (_, first), (_, last) = line_of(parsed(figure(trace([0, 1], [2.0, 2.0]))))
    assert TOP <= first == last <= SIZE[1] - BOTTOM


def test_names_in_the_legend_do_not_run_into_each_other():
    names = ("energy error a move, %", "power error over its noise", "best")
    text = drawn(figure(*(trace([0, 1], [i, i + 1], name=name) for i, name in enumerate(names))))
    places = [float(x) for x in re.findall(r'<rect x="(\d+)" y="13"', text)]
    assert all(b - a > 6 * len(name) for a, b, name in zip(places, places[1:], names, strict=False))
