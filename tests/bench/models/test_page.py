"""Tables of the page on models, from figures made up for the test."""

from __future__ import annotations

from pathlib import Path

import pytest
from models import page
from models.power import Errors, Size, Speed
from models.static import MethodRow, PosesRow, Spread, StaticTables
from models.ur10e import TRAINED, UNSEEN, Currents
from real import ur10e

PAGE = Path(__file__).resolve().parents[3] / "docs" / "models.md"
PARTS = ("static", "power", "curve", "ur3e", "ur10e", "speed")


def cells(text):
    """Rows of the first table, without its rule."""
    rows = [line for line in text.split("\n\n")[0].splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows if "---" not in row]


def test_a_part_is_replaced_and_the_rest_left_alone(tmp_path):
    file = tmp_path / "page.md"
    begin, end = "<!-- bench/models.py: {} -->", "<!-- end -->"
    first, second = (f"{begin.format(name)}\n{text}\n{end}\n" for name, text in (("a", "old"), ("b", "kept")))
    file.write_text(f"before\n{first}between\n{second}")
    page.replace(file, "a", "new")
    text = file.read_text()
    assert "old" not in text
    assert text.startswith("before\n<!-- bench/models.py: a -->\n\nnew\n\n<!-- end -->\nbetween\n")
    assert text.endswith(second)
    page.replace(file, "a", "new")
    assert file.read_text() == text
    with pytest.raises(ValueError, match=r"page\.md has no line <!-- bench/models\.py: c -->"):
        page.replace(file, "c", "new")


def test_the_page_has_a_place_for_every_part():
    text = PAGE.read_text()
    for part in PARTS:
        _, found, rest = text.partition(f"<!-- bench/models.py: {part} -->")
        assert found, part
        assert "|" in rest.partition("<!-- end -->")[0] or part == "speed"


def test_arms_at_rest():
    def spread(middle):
        return Spread.of([middle, 0.9 * middle, 1.1 * middle])

    rows = (
        MethodRow(
            "gravity", spread(20.0), spread(0.72), spread(23.0), Spread(0.57, 0.29, 0.91), (29.31, 0.687, 15.783)
        ),
        MethodRow("best", spread(1.0), Spread(0.9993, 0.9988, 0.9994), spread(1.2), Spread(0.99998, 0.9, 1.0), None),
    )
    tables = StaticTables(
        rows, (PosesRow(20, spread(0.7), spread(0.9)),), Spread(97, 96, 100), 4, 5, 12, spread(30.0), spread(40.0)
    )
    text = page.static(tables)
    head, gravity, best = cells(text)
    assert len(head) == len(gravity) == len(best) == 6
    assert gravity[1:4] == ["29.31 / 0.687 / 15.8", "20.00 (18.00 … 22.00)", "0.72 (0.65 … 0.79)"]
    assert gravity[5] == "0.57 (0.29 … 0.91)"
    assert best[1] == "–"
    assert best[3] == "0.99930 (0.99880 … 0.99940)"  # more decimals where there is more to tell
    assert "5 arms; the paper's order is kept on 4 of them" in text
    assert "30.0 (27.0 … 33.0) s" in text
    assert "| 20 | 0.70 (0.63 … 0.77) |" in text
    assert "12 arms" in text


def errors(arm, method, energy, power, noise=0.5, current=(2.0, 5.0)):
    return Errors(arm, method, energy, 2 * energy, power, noise, current)


def test_arms_in_motion_are_put_together_by_kind_and_the_worst_move_is_that_of_all():
    found = [errors(f"six axes, {seed}", "NLS", energy, 1.0) for seed, energy in ((1, 0.2), (2, 0.9), (3, 0.4))]
    found += [errors("six axes, 1", "best", 0.1, 0.6), errors("burdened, 1", "best", 0.3, 0.55)]
    _, nls, best, burdened = cells(page.power(found))
    assert nls == ["six axes", "NLS", "1.54", "0.40 (0.20 … 0.90)", "1.80", "2.00 (2.00 … 2.00)", "5.0 (5.0 … 5.0)"]
    assert best[:3] == ["six axes", "best", "–"]
    assert burdened[:2] == ["burdened", "best"]


def test_number_of_moves_and_time_of_a_frame():
    assert cells(page.curve([Size(5, 0.42, 0.0591, 1.034, 3.68)]))[1] == ["5", "0.4", "0.059", "1.03", "3.7"]
    told = "Window of 21: 42 µs a frame in the median, 99 % below 101 µs; 45 µs of processor time in the mean."
    assert page.speed(Speed(21, 42.4, 101.2, 44.6)) == told


def test_the_ur3e_stands_beside_ecbot():
    text = page.ur3e([errors("UR3e", "constant", 8.0, 5.8, 1.52), errors("UR3e", "best", 1.94, 2.18, 1.52)])
    assert cells(text)[2] == ["best", "2.18", "1.94", "3.9"]
    assert "1.52 W" in text
    assert "1.45 to 5.25 W" in text


def test_the_ur10e_has_each_joint_in_per_cent_and_ampere():
    text = page.ur10e([Currents("a", "the bare arm", (7.5,) * 6, (0.2,) * 6)])
    assert cells(text)[1] == ["a", "the bare arm", *["7.5 (0.20)"] * 6]
    assert "9.88 %" in text


def test_no_recording_is_judged_that_was_trained_on():
    bare = set(TRAINED)
    assert not bare & {*UNSEEN, ur10e.LOAD}
    assert ur10e.LOAD.removesuffix("Load") in UNSEEN  # the same path without the load was not trained on either
