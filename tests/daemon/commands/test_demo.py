"""What ``cellwatt demo`` says and ends with, by the summary of its run."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cellwatt.demo.demonstration import Demonstration
from cellwatt.live.bulletin import line_of
from tests.daemon.commands.calling import Call, call
from tests.daemon.live import cells

__all__ = ["call"]

STREAM = {"nominal_hz": 500.0, "rate_hz": 499.98, "jitter_p99_ms": 0.4, "samples": 15000, "delivered": 15000}
GOOD: dict[str, Any] = {
    "ok": True,
    "frames": 1500,
    "intervals": 40,
    "tasks": 8,
    "fault": {"statement": "Joint 3 needs more torque than it did.", "delay_s": 1.5},
    "meter": {"statement": "mains.supply.power is averaged over 100 ± 5 ms and delayed by 30 ± 2 ms."},
    "problems": [],
    "sources": {
        "arm": {
            "lost": 0,
            "host_stalled": 0,
            "streams": {"rtde": STREAM, "io": STREAM | {"nominal_hz": 0.0, "rate_hz": None}},
        }
    },
}
BAD = GOOD | {"ok": False, "problems": ["arm lost 3 samples"]}


@pytest.fixture
def folders(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Runs that give ``summary`` at once; where they were told to keep what they record."""
    seen: dict[str, Any] = {"summary": GOOD}

    async def run(demonstration: Any) -> dict[str, Any]:
        seen["folder"] = next(v for v in vars(demonstration).values() if isinstance(v, Path))
        return seen["summary"]

    monkeypatch.setattr(Demonstration, "run", run)
    return seen


def test_a_good_run(call: Call, folders: dict[str, Any]) -> None:
    ended = call("demo", "--seconds", "20")
    assert ended.code == 0
    assert "nothing was lost, and the alarm named the right joint in time" in ended.out
    assert "alarm 1.5 s after the spring: Joint 3 needs more torque than it did." in ended.out
    assert "averaged over 100 ± 5 ms" in ended.out
    assert "499.98 Hz" in ended.out
    assert "on change" in ended.out


def test_a_run_that_lost_something(call: Call, folders: dict[str, Any]) -> None:
    folders["summary"] = BAD
    ended = call("demo")
    assert ended.code == 1
    assert "arm lost 3 samples" in ended.out
    assert "nothing was lost" not in ended.out


def test_what_the_host_held_up_is_told_and_fails_nothing(call: Call, folders: dict[str, Any]) -> None:
    folders["summary"] = GOOD | {"sources": {"arm": GOOD["sources"]["arm"] | {"host_stalled": 7}}}
    ended = call("demo")
    assert ended.code == 0
    assert "arm: 7 samples missed because this PC was stalled or busy otherwise" in ended.out


def test_what_happens_is_a_line_at_once_where_the_output_is_no_terminal(
    call: Call, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out: list[str] = []

    async def run(demonstration: Any) -> dict[str, Any]:
        out.append(capsys.readouterr().out)
        demonstration.say("running for 30 s; in a browser: http://127.0.0.1:8080")
        out.append(capsys.readouterr().out)
        for message in (cells.health(), cells.task(4), cells.interval(1, (2,), 1.0), cells.alarm("elbow")):
            demonstration.show(json.loads(json.dumps(line_of(message))))
        out.append(capsys.readouterr().out)
        return GOOD

    monkeypatch.setattr(Demonstration, "run", run)
    ended = call("demo")
    assert out[:2] == ["", "running for 30 s; in a browser: http://127.0.0.1:8080\n"]
    told = [line.split(" ", 1)[1] for line in out[2].splitlines()]
    assert told[:2] == ["source arm: ok", "source board: ok"]
    assert told[2].startswith("plant-1/weld-3 is green: 2 of 2 sources ok")
    assert told[3:] == ["task task_1 × 4 (speed=1.00), 9.00 s", "error: elbow is wrong."]
    assert ended.out.endswith("nothing was lost, and the alarm named the right joint in time\n")


@pytest.mark.parametrize(("summary", "code"), [(GOOD, 0), (BAD, 1)])
def test_in_json(call: Call, folders: dict[str, Any], summary: dict[str, Any], code: int) -> None:
    folders["summary"] = summary
    ended = call("demo", "--json")
    assert (ended.code, json.loads(ended.out)) == (code, summary)


def test_what_is_kept(call: Call, folders: dict[str, Any], tmp_path: Path) -> None:
    ended = call("demo", "--keep", tmp_path / "kept")
    assert folders["folder"] == tmp_path / "kept"
    assert f"try: cellwatt plot {tmp_path / 'kept'}" in ended.out
    call("demo")
    assert not folders["folder"].exists(), "nothing is left behind otherwise"
