"""A report page: whole in itself, safe to open, and it says what it was made from."""

from __future__ import annotations

import hashlib
import math
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

from cellwatt import __version__, report
from cellwatt.errors import CellwattError
from cellwatt.report import page as page_module
from cellwatt.report.drawing import band, curve, note, stretch
from tests.daemon.report.reading import Page, check

NASTY = "<script>alert('x')</script><a href=x>\"&"


def figure(text: str = "one", when: int = 0) -> report.Figure:
    panels = [report.Panel([curve(text, [1.0, 2.0], "#000000")], report.Axis("s"), report.Axis(text), title=text)] * 2
    marks = [*band(-1, 1, "#000000"), stretch(0, 1, "#000000"), note(text, 0.5, 1.0)]
    last = report.Panel([curve("two", [3.0, math.nan], "#000000")], marks=marks)
    return report.Figure(f"two panels over one, {text}", [panels, [last]], (100, 50), when=("run", when))


def page(text: str = "plain") -> Page:
    one_bar = report.Bars([(text, "model", 3.0)], "N*m", 1.0)
    blocks = [
        text,
        figure(text),
        figure(text, 1),
        report.Switch("run", (text, "other")),
        report.Table(f"table {text}", (text, "W"), [(text, "−1.5 ± 0.1"), ("b", "2")]),
        report.Card(text, [text, report.Columns([text], [one_bar])], text, text),
        report.Folded(text, [report.Notes([text])]),
    ]
    sections = [report.Section(text, blocks, text), report.Section("empty", [])]
    tiles = [report.Tile(text, text, text)]
    made = report.Report(text, "a test", [text], text, sections, tiles=tiles, tiles_remark=text, beside=text)
    return Page(made.html())


def test_a_page_has_headings_figures_and_tables_and_needs_nothing_else() -> None:
    read = page()
    check(read)
    assert read.title == "plain: a test"
    assert read.headings == [("h1", "plain"), ("h2", "plain"), ("h3", "plain")]
    assert read.tables["table plain"] == [["plain", "W"], ["plain", "−1.5 ± 0.1"], ["b", "2"]]
    assert "data-run=0 style" in read.words
    assert "data-run=1 hidden" in read.words


def test_foreign_text_is_never_markup() -> None:
    read = page(NASTY)
    assert "<script>alert" not in read.text
    assert "<a " not in read.text
    assert read.headings[0] == ("h1", NASTY)
    assert "<a " not in str([f["data"] for f in read.figures]) + str([f["layout"] for f in read.figures])


def test_panels_have_their_place_and_marks_their_axes() -> None:
    drawn = figure().plotly()
    layout = drawn["layout"]
    assert [t["xaxis"] for t in drawn["data"]] == ["x1", "x2", "x3"]
    assert [t["showlegend"] for t in drawn["data"]] == [True, False, True]
    assert layout["xaxis"]["domain"][1] < layout["xaxis2"]["domain"][0]
    assert layout["xaxis3"]["domain"] == [0.0, 1.0]
    assert layout["yaxis3"]["domain"][1] < layout["yaxis"]["domain"][0]
    inner = layout["height"] - layout["margin"]["t"] - layout["margin"]["b"]
    heights = [inner * (layout[axis]["domain"][1] - layout[axis]["domain"][0]) for axis in ("yaxis", "yaxis3")]
    assert heights == pytest.approx([100, 50])
    assert [(s["xref"], s["yref"]) for s in layout["shapes"]] == [("x3 domain", "y3"), ("x3", "y3 domain")]
    assert layout["annotations"][-1]["xref"] == "x3"


def test_it_says_files_version_command_and_settings(tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    file = tmp_path / "folder" / "in put.csv"
    file.write_text("t,power\n")

    @click.command()
    @click.argument("inputs", nargs=-1, type=click.Path(path_type=Path))
    @click.option("--seed", default=3)
    @click.option("--quick", is_flag=True)
    def demo(inputs: tuple[Path, ...], seed: int, quick: bool) -> None:
        made = report.Provenance.here(inputs)
        click.echo(report.Report("a", "b", [], "c", [], provenance=made).html())

    read = Page(CliRunner().invoke(demo, [str(file.parent), "--quick"], prog_name="cellwatt demo").output)
    assert read.tables["Files"][1:] == [[str(file), hashlib.sha256(b"t,power\n").hexdigest()]]
    assert read.tables["Settings"][1:] == [["inputs", str(file.parent)], ["seed", "3"], ["quick", "yes"]]
    assert f"<code>cellwatt demo {file.parent} --quick</code>" in read.words
    assert f"Made by cellwatt {__version__} from 1 file" in read.words


def test_what_cannot_be_written_is_said_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(CellwattError, match=r"page.html cannot be written: Is a directory"):
        (tmp_path / "page.html").mkdir()
        report.Report("a", "b", [], "c", []).write(tmp_path / "page.html")


def test_missing_plotly_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "plotly.offline", None)
    with pytest.raises(CellwattError, match=r"the report needs plotly: pip install 'cellwatt\[plot\]'"):
        page_module._engine.__wrapped__()
