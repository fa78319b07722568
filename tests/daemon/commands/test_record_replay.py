"""``record`` and ``replay`` on a device that does what it is told."""

from __future__ import annotations

import json
import os
import signal
from pathlib import Path

import pytest

from cellwatt import Batch
from cellwatt.record import Recording
from tests.daemon.commands.calling import CELL, Call, call, cell
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
