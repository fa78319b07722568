"""``record`` and ``replay`` on a device that does what it is told."""

from __future__ import annotations

import asyncio
import json
import sys
import weakref
from asyncio.subprocess import PIPE
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from cellwatt import Batch
from cellwatt.frames import Frames
from cellwatt.record import Recording
from cellwatt.runtime.replaying import replay_frames
from cellwatt.testing import EmulatedDevice, Rig
from cellwatt_drivers.scpi_analyzer import ScpiAnalyzerDriver
from tests.daemon.commands.calling import CELL, Call, call, cell
from tests.daemon.runtime.fakes import DEVICES, JUDGES, alarm, answer, config_of, give, running

__all__ = ["call", "cell"]


@pytest.fixture
def recording(call: Call, tmp_path: Path) -> Path:
    """The record of 40 samples."""

    async def record() -> None:
        DEVICES["arm"].tell(answer, give(40))
        async with running(config_of(record=tmp_path / "kept", outlets={})):
            await DEVICES["arm"].done()

    asyncio.run(record())
    return tmp_path / "kept"


def test_record_says_what_came_and_publishes_and_judges_nothing(tmp_path: Path) -> None:
    """In processes of its own, as the daemon; what it says is in the record."""
    file = tmp_path / "weld.yaml"
    rig = Rig(ScpiAnalyzerDriver, {}, options={"model": "hmc8015"})

    async def recorded(*how: str) -> tuple[str, str]:
        async with EmulatedDevice(rig, tmp_path) as device:
            host, _, port = device.address.rpartition(":")
            source = f"{{driver: scpi_analyzer, host: {host}, port: {port}, rate: 50 Hz}}"
            rest = "record: {folder: recordings, frames: false}\nstages: {meter: {}}\n"
            file.write_text(f"site: plant\ncell: weld\nsources:\n  meter: {source}\n{rest}")
            command = [sys.executable, "-m", "cellwatt.commands", "record", file, "--seconds", "0.5", *how]
            ended = await asyncio.create_subprocess_exec(*map(str, command), stdout=PIPE, stderr=PIPE)
            out, err = await ended.communicate()
            assert ended.returncode == 0, err.decode()
            return out.decode(), err.decode()

    out, err = asyncio.run(recorded("--out", str(tmp_path / "kept")))
    assert err == f"recording in {tmp_path / 'kept'}\n"
    first, last = out.splitlines()
    assert last == f"recorded in {tmp_path / 'kept'}"
    found = Recording.open(tmp_path / "kept")
    assert first.startswith(f"meter: {sum(len(e) for e in found.entries() if isinstance(e, Batch))} of ")
    assert found.layout is None, "frames are not recorded, as the file says"
    assert not (tmp_path / "recordings").exists()
    final = json.loads(asyncio.run(recorded("--json"))[0])
    assert (final["sources"]["meter"]["state"], final["stages"], final["sinks"]) == ("ok", {}, {})
    assert list((tmp_path / "recordings").glob("*.mcap"))


def test_replay_gives_the_frames_that_were_recorded(call: Call, recording: Path) -> None:
    ended = call("replay", recording, "--verify")
    count = sum(len(f) for f in Recording.open(recording).frames())
    assert count >= 39
    assert ended.code == 0
    assert ended.out == f"identical: {count} frames agree in every bit\n{count} frames, results: none\n"


def test_replay_keeps_no_frames(call: Call, recording: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[weakref.ref[Any]] = []

    def watched(*given: Any) -> Iterator[Frames]:
        for block in replay_frames(*given):
            seen.append(weakref.ref(block.values))
            assert sum(ref() is not None for ref in seen) < 5
            yield block

    monkeypatch.setattr("cellwatt.commands.replay.replay_frames", watched)
    assert call("replay", recording).code == 0
    assert len(seen) > 8


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
