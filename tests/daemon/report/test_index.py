"""The index of a folder's pages: newest first, by kind, the broken named, the foreign passed over."""

from __future__ import annotations

import base64
import gzip
import json
import os
import re
from dataclasses import replace
from datetime import UTC, datetime
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from cellwatt import report
from cellwatt.commands.reports import command
from cellwatt.errors import CellwattError
from cellwatt.report.drawing import bars, cells, curve, dots, line
from cellwatt.report.facts import facts_in
from cellwatt.report.thumbnail import HEIGHT, LARGEST, WIDTH, drawn
from cellwatt.version import __version__
from tests.daemon.report.reading import Page, check, read

X = report.Axis("s")


def of(*traces: dict[str, Any], x: report.Axis = X, y: report.Axis = X) -> report.Figure:
    return report.Figure("a picture", [[report.Panel(traces, x, y)]], (100,))


CURVES = of(curve("power", np.sin(np.arange(5000) / 300), "#2f86d1", step=0.02))


def write(path: Path, kind: str, finding: str, day: int, tone: Any = "found", *blocks: report.Block) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    origin = report.Provenance({"a.mcap": "00"}, "cellwatt plot a.mcap", {}, datetime(2026, 3, day, 8, 30, tzinfo=UTC))
    shown = [report.Section("Shown", blocks)]
    report.Report("weld-3", kind, ["2 recordings"], finding, shown, tone, provenance=origin).write(path)
    return path


class _Entries(HTMLParser):
    """Links of the index in order: heading, address, text, and whether there is a picture."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[list[Any]] = []
        self._heading = ""
        self._inside = ""
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._inside = tag
        if tag == "h2":
            self._heading = ""
        elif tag == "a":
            self.found.append([self._heading, dict(attrs)["href"], "", False])
        elif tag == "svg":
            self.found[-1][3] = True

    def handle_data(self, data: str) -> None:
        if self._inside == "h2":
            self._heading += data
        elif self._inside == "b" and self.found:
            self.found[-1][2] += data

    def handle_endtag(self, tag: str) -> None:
        self._inside = ""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    kept = tmp_path / "kept"
    write(kept / "monday.html", "faults", "Joint 2 rubs.", 2, "part", CURVES)
    write(kept / "friday.html", "faults", "None of 9 cycles shows a fault.", 6, "good", CURVES)
    write(kept / "deep" / "a #1.html", "recording", "<script>alert(1)</script>", 4)
    (kept / "other.html").write_text("<!doctype html><title>Somebody else's</title>")
    whole = write(kept / "torn.html", "recording", "No alarms.", 5).read_text()
    (kept / "torn.html").write_text(whole[: len(whole) // 2])
    os.mkfifo(kept / "pipe.html")
    bomb = write(kept / "bomb.html", "recording", "No alarms.", 5, "good", CURVES)
    packed = base64.b64encode(gzip.compress(bytes(LARGEST + 1), 1)).decode()
    bomb.write_text(re.sub("(type=text/plain>)[^<]*", rf"\g<1>{packed}", bomb.read_text()))
    strange = write(kept / "strange.html", "recording", "No alarms.", 5)
    strange.write_text(strange.read_text().replace('"finding":', '"finds":'))
    return kept


def run(*arguments: object) -> Result:
    return CliRunner().invoke(command, list(map(str, arguments)), catch_exceptions=False)


def test_a_page_carries_its_facts(folder: Path) -> None:
    found = facts_in(folder / "deep" / "a #1.html")
    assert found is not None
    facts, _ = found
    assert (facts.name, facts.kind, facts.finding) == ("weld-3", "recording", "<script>alert(1)</script>")
    assert (facts.about, facts.files, facts.command) == (("2 recordings",), {"a.mcap": "00"}, "cellwatt plot a.mcap")
    assert (facts.made, facts.version) == ("2026-03-04T08:30:00+00:00", __version__)
    check(read(folder / "deep" / "a #1.html"))


def test_newest_first_by_kind_with_finding_and_picture(folder: Path) -> None:
    ended = run(folder)
    assert ended.exit_code == 0
    assert f"wrote {folder / 'index.html'}: 3 reports\n" in ended.output
    text = (folder / "index.html").read_text()
    assert _Entries(text).found == [
        ["Faults", "friday.html", "None of 9 cycles shows a fault.", True],
        ["Faults", "monday.html", "Joint 2 rubs.", True],
        ["Recording", "deep/a%20%231.html", "<script>alert(1)</script>", False],
    ]
    page = Page(text)
    assert page.headings[0] == ("h1", "3 reports, the newest first.")
    assert "://" not in text
    assert "<script>alert" not in text


def test_broken_pages_are_named_and_others_passed_over(folder: Path) -> None:
    broken = json.loads(run(folder, "--json").stdout)["broken"]
    assert broken == [
        f"{folder / 'bomb.html'}: its first figure cannot be read",
        f"{folder / 'pipe.html'}: cannot be read: a FIFO, expected a file",
        f"{folder / 'strange.html'}: its facts cannot be read: make the page anew",
        f"{folder / 'torn.html'}: the page ends too early: make it anew",
    ]
    run(folder)
    assert all(str(text) in (folder / "index.html").read_text() for text in broken)


def test_the_index_does_not_list_itself_and_may_lie_elsewhere(folder: Path, tmp_path: Path) -> None:
    run(folder)
    first = run(folder, "--out", tmp_path / "all.html")
    assert ": 3 reports" in first.output
    assert _Entries((tmp_path / "all.html").read_text()).found[0][1] == "kept/friday.html"


def test_json_gives_the_facts_and_writes_nothing(folder: Path) -> None:
    found = json.loads(run(folder, "--json").stdout)["reports"]
    assert [(each["made"][:10], each["tone"]) for each in found] == [
        ("2026-03-06", "good"),
        ("2026-03-04", "found"),
        ("2026-03-02", "part"),
    ]
    assert not (folder / "index.html").exists()


def test_an_empty_folder_and_one_that_cannot_be_written(tmp_path: Path) -> None:
    assert ": 0 reports" in run(tmp_path).output
    assert "No reports are here." in (tmp_path / "index.html").read_text()
    with pytest.raises(CellwattError, match="cannot be written"):
        run(tmp_path, "--out", tmp_path / "none" / "index.html")


def points(svg: str) -> list[tuple[float, float]]:
    """Corners of the lines in a picture."""
    words = svg.split(' d="')[1].split('"')[0].replace("M", " ").replace("L", " ").split()
    numbers = list(map(float, words))
    return list(zip(numbers[::2], numbers[1::2], strict=True))


def test_a_curve_fills_its_picture_and_keeps_its_peak() -> None:
    values = np.zeros(100_000)
    values[70_000] = 5.0
    found = points(drawn(of(curve("a", values, "#2f86d1")).plotly()))
    assert min(x for x, _ in found) == pytest.approx(4, abs=1)
    assert max(x for x, _ in found) == pytest.approx(WIDTH - 4, abs=1)
    (peak,) = [x for x, y in found if y < 10]
    assert peak == pytest.approx(4 + 0.7 * (WIDTH - 8), abs=2)
    assert all(y == HEIGHT - 4 for x, y in found if x != peak)


def test_a_logarithmic_axis_is_one_in_the_picture() -> None:
    found = points(drawn(of(line("a", [1, 10, 100], [1, 2, 3], "#000000"), x=replace(X, log=True)).plotly()))
    assert [x for x, _ in found] == pytest.approx([4, WIDTH / 2, WIDTH - 4], abs=1)


def test_bars_dots_and_cells_are_drawn_in_their_rows() -> None:
    names = report.Axis(names=True)
    stacked = drawn(
        of(bars("a", ["x", "y"], [1, 2], "#2b8a57"), bars("b", ["x", "y"], [3, 2], "#c0392b"), y=names).plotly()
    )
    assert stacked.count("<rect") == 4
    shaded = drawn(of(cells([1, 2], ["r", "s"], np.array([[1, np.nan], [0, 2.0]]), [["", ""]] * 2), y=names).plotly())
    assert shaded.count("<rect") == 2
    assert drawn(of(dots("a", [1, 2, 3], [1, np.nan, 3], "#000000")).plotly()).count("h.1") == 2


def test_the_largest_panel_is_the_one_that_is_drawn() -> None:
    small, large = report.Panel([curve("a", [1, 2], "#000000")]), report.Panel([curve("b", [1, 2], "#ffffff")])
    assert 'stroke="#ffffff"' in drawn(report.Figure("two", [[small], [large]], (20, 90)).plotly())
