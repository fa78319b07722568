"""``cellwatt plot``: one page that needs nothing else."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cellwatt.results import Alarm, Interval
from tests.daemon.commands.calling import Call, call
from tests.daemon.record import making
from tests.daemon.report.reading import check, read

__all__ = ["call"]

START = making.SESSION
MOVES = Interval("arm", 1, START, START + 400_000_000, (1, 3), (0.5,) * 3, (0.0,) * 3, (0.1,) * 3)
HEAT = Alarm("heat", "heat", "warning", True, START, START + 200_000_000, "Joint 2 is hot.", source="arm", joint=2)
HOTTER = replace(HEAT, time=START + 300_000_000, statement="Joint 2 is hotter.")


@pytest.fixture
def recordings(tmp_path: Path) -> Path:
    (tmp_path / "kept").mkdir()
    chunk = [making.batch_of(0, 50), making.frames_of(0, 25), MOVES, HEAT, HOTTER]
    making.write_chunks(tmp_path / "kept", [chunk], header=making.weld(""))
    return tmp_path / "kept"


def test_a_page(call: Call, recordings: Path, tmp_path: Path) -> None:
    ended = call("plot", recordings, "--out", tmp_path / "page.html")
    assert (ended.code, ended.out) == (0, f"wrote {tmp_path / 'page.html'}\n")
    page = read(tmp_path / "page.html")
    check(page)
    assert page.headings[0] == ("h1", "1 alarm was raised.")
    assert page.tables["Alarms"][1:] == [["0.20 s", "warning", "Joint 2 is hot."]]
    (figure,) = page.figures
    names = [trace["name"] for trace in figure["data"]]
    assert all(f"joint_{n}.position" in names for n in (1, 2, 3))
    assert "1+3" in [note["text"] for note in figure["layout"]["annotations"]]


def test_units_of_the_cell_and_of_the_command_line(call: Call, tmp_path: Path) -> None:
    chunk = [making.batch_of(0, 50), making.frames_of(0, 25), MOVES]
    making.write_chunks(tmp_path, [chunk], header=making.weld("units: {angle: deg}"))
    (file,) = tmp_path.glob("*.mcap")

    def shown(*arguments: str) -> dict[str, list[float]]:
        assert call("plot", file, "--out", tmp_path / "page.html", *arguments).code == 0
        (figure,) = read(tmp_path / "page.html").figures
        titles = [note["text"] for note in figure["layout"]["annotations"] if "position" in note["text"]]
        curve = next(t["y"] for t in figure["data"] if t["name"] == "joint_1.position")
        return {titles[0]: [value for value in curve if value is not None]}

    ((degrees, in_degrees),) = shown().items()
    ((radians, in_radians),) = shown("--units", "SI").items()
    assert (degrees, radians) == ("<b>arm · position [°]</b>", "<b>arm · position [rad]</b>")
    assert in_degrees == pytest.approx([57.29577951308232 * value for value in in_radians], abs=0.01)
    ended = call("plot", file, "--units", "furlong")
    assert (ended.code, "no unit 'furlong'" in ended.err) == (2, True)


def test_some_of_it(call: Call, recordings: Path, tmp_path: Path) -> None:
    out = ("--out", tmp_path / "page.html")
    assert call("plot", recordings, *out, "--channel", "joint_2", "--from", "0.1", "--to", "0.3").code == 0
    (figure,) = read(tmp_path / "page.html").figures
    assert {trace["name"] for trace in figure["data"]} == {"joint_2.position"}
    assert figure["layout"]["xaxis"]["range"] == pytest.approx([0.1, 0.3])


def test_sessions_that_lie_days_apart_take_no_memory_for_the_time_between(call: Call, tmp_path: Path) -> None:
    first, later = making.frames_of(0, 25), making.frames_of(25, 25)
    later = replace(later, time=later.time + 6 * 86_400 * 10**9)
    making.write_chunks(tmp_path, [[making.batch_of(0, 50), first, later, MOVES]], header=making.weld(""))
    tracemalloc.start()
    assert call("plot", tmp_path, "--out", tmp_path / "page.html").code == 0
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert most < 200e6, "six days of 50 frames a second are 207 MB a channel"
    (figure,) = read(tmp_path / "page.html").figures
    trace = next(t for t in figure["data"] if t["name"] == "joint_1.position")
    known = [n for n, value in enumerate(trace["y"]) if value is not None]
    assert 8 >= len(known) >= 4 and known[0] == 0 and len(trace["y"]) <= 8000
    assert (known[-1] * trace["dx"]) == pytest.approx(6 * 86_400, rel=1e-3)
    values = [value for value in trace["y"] if value is not None]
    given = np.concatenate([first.values[:, 0], later.values[:, 0]])
    assert (min(values), max(values)) == pytest.approx((given.min(), given.max()), abs=1e-2)


def test_a_table_has_every_column_and_a_gap_where_rows_are_missing(call: Call, tmp_path: Path) -> None:
    rows = [f"{10 + i / 100:.2f},{i},{2 * i},{7 if i == 5 else ''},on" for i in range(60) if not 20 <= i < 30]
    (tmp_path / "log.csv").write_text("time,q_1 [deg],q_2 [deg],power,state\n" + "\n".join(rows))
    assert call("plot", tmp_path / "log.csv", "--out", tmp_path / "page.html").code == 0
    page = read(tmp_path / "page.html")
    check(page)
    (figure,) = page.figures
    shown = {trace["name"]: trace for trace in figure["data"]}
    assert list(shown) == ["q_1 [deg]", "q_2 [deg]", "power"]
    assert shown["q_2 [deg]"]["y"][19:31] == [38, *[None] * 10, 60]
    assert (shown["q_2 [deg]"]["x0"], round(shown["q_2 [deg]"]["dx"], 4)) == (0, 0.01)
    assert [note["text"] for note in figure["layout"]["annotations"]] == ["<b>q [deg]</b>", "<b>power</b>"]
    ended = call("plot", tmp_path / "log.csv", "--out", tmp_path / "page.html", "--channel", "torque")
    assert ended.code == 3 and "no such columns" in ended.err
