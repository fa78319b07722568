"""``record`` and ``replay`` on a device that does what it is told."""

from __future__ import annotations

import json
import os
import signal
from dataclasses import replace
from pathlib import Path

import pytest

from cellwatt import Batch
from cellwatt.record import Recording
from cellwatt.report import Provenance
from cellwatt.runtime.replaying import compare
from cellwatt.runtime.replaying_report import report
from tests.daemon.commands.calling import CELL, Call, call, cell
from tests.daemon.report.reading import check, read
from tests.daemon.runtime.fakes import DEVICES, JUDGES, RECEIVERS, alarm, answer, drop, give, miss

__all__ = ["call", "cell"]


async def end(_):
    os.kill(os.getpid(), signal.SIGTERM)


@pytest.fixture
def recording(call: Call, cell: Path, tmp_path: Path) -> Path:
    """What ``record`` left of 40 samples."""
    DEVICES["arm"].tell(answer, give(40), end)
    assert call("record", cell, "--out", tmp_path / "kept").code == 0
    return tmp_path / "kept"


def test_record_tells_what_came_and_what_was_lost(call: Call, cell: Path, tmp_path: Path) -> None:
    DEVICES["arm"].tell(answer, give(5), miss(2, "gap"), drop(1, "checksum"), end)
    ended = call("record", cell, "--out", tmp_path / "kept")
    assert ended.out == f"arm: 5 of 8 samples, 3 lost\nrecorded in {tmp_path / 'kept'}\n"
    assert not RECEIVERS["zenoh"].runs, "nothing is published"
    batches = [e for e in Recording.open(tmp_path / "kept").entries() if isinstance(e, Batch)]
    assert sum(map(len, batches)) == 5


def test_record_in_json(call: Call, cell: Path, tmp_path: Path) -> None:
    DEVICES["arm"].tell(answer, give(5), end)
    cell.write_text(CELL + "record: {folder: recordings}\n")
    final = json.loads(call("record", cell, "--json").out)
    assert final["sources"]["arm"]["received"] == 5
    assert list((tmp_path / "recordings").glob("*.mcap"))


def test_record_for_a_while(call: Call, cell: Path, tmp_path: Path) -> None:
    ended = call("record", cell, "--out", tmp_path / "kept", "--seconds", "0.01")
    assert (ended.code, ended.out.splitlines()[0]) == (0, "arm: 0 of 0 samples, 0 lost")


def test_another_folder_changes_nothing_else(call: Call, cell: Path, tmp_path: Path) -> None:
    DEVICES["arm"].tell(answer, give(20), end)
    cell.write_text(CELL + "record: {folder: recordings, frames: false}\n")
    assert call("record", cell, "--out", tmp_path / "kept").code == 0
    assert Recording.open(tmp_path / "kept").layout is None, "frames are not recorded, as the file says"
    assert not (tmp_path / "recordings").exists()


def test_replay_gives_the_frames_that_were_recorded(call: Call, recording: Path) -> None:
    ended = call("replay", recording, "--verify")
    count = sum(len(f) for f in Recording.open(recording).frames())
    assert count >= 39
    assert ended.code == 0
    assert ended.out == f"identical: {count} frames agree in every bit\n{count} frames, results: none\n"


def test_other_frames_are_not_identical(call: Call, recording: Path, cell: Path) -> None:
    cell.write_text(CELL + "frames: {rate: 25 Hz}\n")
    ended = call("replay", recording, "--verify", "--settings", cell, "--json")
    summary = json.loads(ended.out.splitlines()[-1])
    assert (ended.code, summary["identical"]) == (1, False)
    assert summary["verified"]["only_recorded"] > 0
    assert call("replay", recording, "--verify", "--settings", cell).out.startswith("not identical: ")


def test_replay_through_a_stage(call: Call, recording: Path, cell: Path) -> None:
    cell.write_text(CELL + "stages: {judge: {}}\n")
    first = next(iter(Recording.open(recording).frames())).sequence
    JUDGES["judge"].give = lambda frames, _: [alarm()] if frames.sequence == first else ()
    JUDGES["judge"].last = lambda: [alarm(active=False)]
    ended = call("replay", recording, "--settings", cell)
    assert ended.out.splitlines()[:2] == ["warning: Joint 2: heat.", "cleared: Joint 2: heat."]
    assert ended.out.splitlines()[-1].endswith("results: {'alarm': 2}")
    lines = [json.loads(line) for line in call("replay", recording, "--settings", cell, "--json").out.splitlines()]
    assert [line.get("active") for line in lines[:2]] == [True, False]
    assert lines[-1]["results"] == {"alarm": 2}


def test_replay_at_a_pace_gives_the_same(call: Call, recording: Path) -> None:
    assert call("replay", recording, "--verify", "--speed", "1000").out == call("replay", recording, "--verify").out


def test_the_page_of_a_replay_that_is_identical(call: Call, recording: Path, tmp_path: Path) -> None:
    ended = call("replay", recording, "--report", tmp_path / "page.html")
    assert (ended.code, "add --verify" in ended.err) == (2, True)
    assert call("replay", recording, "--verify", "--report", tmp_path / "page.html").code == 0
    page = read(tmp_path / "page.html")
    check(page)
    count = sum(len(f) for f in Recording.open(recording).frames())
    assert page.headings[0] == ("h1", f"The replay is identical: {count} frames agree in every bit.")
    (figure,) = page.figures
    assert [trace["name"] for trace in figure["data"]] == ["equal"]
    assert sum(figure["data"][0]["y"]) == count
    assert "Channels that differ" not in page.tables


def test_the_page_of_one_that_is_not_names_channels_time_and_size(call: Call, recording: Path, tmp_path: Path) -> None:
    frames = Recording.open(recording).frames_table()
    at, column = 7, 1
    values = frames.values.copy()
    values[at:, column] += 0.25
    shorter = replace(frames, values=values)
    held = compare([frames], [shorter])
    page_of = report(Recording.open(recording), held, [shorter], [], Provenance.here())
    page_of.write(tmp_path / "page.html")
    page = read(tmp_path / "page.html")
    check(page)
    total = len(frames)
    differ = int((values[:, column] != frames.values[:, column]).sum())
    assert page.headings[0] == (
        "h1",
        f"The replay is not identical: {total - differ} of {total} frames agree in every bit.",
    )
    (row,) = page.tables["Channels that differ"][1:]
    assert row[:2] == [frames.layout.names[column], str(differ)]
    assert row[2].startswith(f"{(int(frames.time[at]) - int(frames.time[0])) * 1e-9:.3f} s (")
    assert row[3:] == ["0.250", frames.layout.channels[column].unit]
    sums = {trace["name"]: sum(trace["y"]) for trace in page.figures[0]["data"]}
    assert sums == {"equal": total - differ, "different": differ}
