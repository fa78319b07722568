"""Curves, stripes and lines drawn as SVG."""

import re
from xml.etree import ElementTree

import numpy as np
import pytest

from cellwatt.report import Axis, Figure, Panel
from cellwatt.report.drawing import curve, line, note, stretch, upright
from cellwatt.report.svg import WIDTH, Drawn

SIDES = (70, 190)
INNER = WIDTH - sum(SIDES)


def drawn(*panels: Panel, height: int = 200) -> ElementTree.Element:
    figure = Figure("Power", [[p] for p in panels], [height] * len(panels), "x", sides=SIDES)
    html = Drawn(figure).html()
    return ElementTree.fromstring(html.replace("role=img", 'role="img"').replace("class=wide", 'class="wide"'))


def path_of(tree: ElementTree.Element) -> list[tuple[str, float, float]]:
    (path,) = tree.iter("path")
    found = re.findall(r"([ML])([-\d.]+) ([-\d.]+)", path.attrib["d"])
    return [(pen, float(x), float(y)) for pen, x, y in found]


def test_values_lie_where_their_axis_says():
    values = curve("p", [0.0, 10.0, 5.0], "#123456", start=-1.0, step=1.0)
    tree = drawn(Panel([values], Axis("s", (-1.0, 1.0)), Axis("W", (0.0, 10.0))))
    assert path_of(tree) == [
        ("M", pytest.approx(70.0), pytest.approx(204.0)),
        ("L", pytest.approx(70.0 + INNER / 2), pytest.approx(4.0)),
        ("L", pytest.approx(70.0 + INNER), pytest.approx(104.0)),
    ]


def test_a_gap_is_left_open():
    tree = drawn(Panel([curve("p", [1.0, 2.0, np.nan, 3.0, 4.0], "#123456")]))
    assert [pen for pen, _, _ in path_of(tree)] == ["M", "L", "M", "L"]


def test_stripes_lines_and_notes_stand_at_their_time():
    marks = [stretch(2.0, 4.0, "#ff0000"), upright(5.0, "#00ff00"), note("2+3", 3.0, 0.9), note("outside", 20.0, 0.9)]
    tree = drawn(Panel([line("p", [0.0, 10.0], [0.0, 1.0], "#123456")], Axis("s", (0.0, 10.0)), marks=marks))
    (stripe,) = [r.attrib for r in tree.iter("rect") if r.attrib.get("fill") == "#ff0000"]
    assert float(stripe["x"]) == 70 + round(0.2 * INNER, 1)
    assert float(stripe["width"]) == pytest.approx(0.2 * INNER, abs=0.1)
    (upward,) = [r.attrib for r in tree.iter("line") if r.attrib.get("stroke") == "#00ff00"]
    assert upward["x1"] == upward["x2"] == f"{70 + INNER / 2:.1f}"
    said = [t.text for t in tree.iter("text")]
    assert "2+3" in said and "outside" not in said


def test_ticks_are_round_and_the_last_panel_names_the_axis():
    power = line("p", [0.0, 60.0], [-12.0, 260.0], "#123456")
    panel = Panel([power], Axis("s since the alarm", (-60.0, 10.0)), title="arm · power [W]")
    texts = [t.text for t in drawn(panel, panel).iter("text")]
    assert texts.count("arm · power [W]") == 2 and texts.count("s since the alarm") == 1
    assert {"−60", "−50", "0", "10"} <= set(texts) and texts.count("100") == 2


@pytest.mark.parametrize("values", [[], [np.nan, np.nan], [3.0, 3.0], [0.0], [1e12, 1e12 + 1], [-1e-9, 1e-9]])
def test_whatever_the_values_are_it_is_drawn(values):
    assert drawn(Panel([curve("p", values, "#123456")])) is not None


def test_a_single_frame_is_drawn():
    tree = drawn(Panel([curve("p", [1.0], "#123456", start=-2.0)], Axis("s", (-2.0, -2.0))))
    assert path_of(tree)[0][:2] == ("M", pytest.approx(70.0 + INNER / 2))


def test_names_are_escaped():
    tree = drawn(Panel([curve("<b>&", [1.0, 2.0], "#123456")], title="<i>"))
    assert {"<b>&", "<i>"} <= {t.text for t in tree.iter("text")}
