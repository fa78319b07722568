"""The daemon's own alarms: raised once after patience, cleared once, never flapping."""

from __future__ import annotations

from typing import Any

from cellwatt.runtime.watch import PATIENCE, Watch


def status(**source: Any) -> dict[str, Any]:
    healthy = {
        "state": "ok",
        "error": None,
        "since_s": 5.0,
        "residue": 0,
        "expected": 10,
        "received": 10,
        "missed": {},
        "dropped": {},
    }
    return {"sources": {"arm": healthy | source}, "stages": {}, "sinks": {}, "recorder": {"state": "ok"}}


DOWN = {"state": "retrying", "error": "nobody answers at 192.0.2.1:30004"}


def test_down_source_is_raised_once_and_cleared_once() -> None:
    watch = Watch()
    looks = [watch.look(status(**DOWN), now) for now in range(10)]
    alarms = [a for given in looks for a in given]
    assert [a.kind for a in alarms] == ["source_down"]
    assert looks[PATIENCE - 1] == alarms
    assert "192.0.2.1:30004" in alarms[0].statement
    after = [a for now in range(10, 20) for a in watch.look(status(), now)]
    assert [(a.id, a.active) for a in after] == [(alarms[0].id, False)]


def test_short_trouble_is_not_raised() -> None:
    watch = Watch()
    for now in range(20):
        flicker = status(**DOWN) if now % PATIENCE else status()
        assert watch.look(flicker, now) == []


def test_samples_that_do_not_add_up_are_an_alarm_with_the_figures() -> None:
    watch = Watch()
    alarms = [a for now in range(PATIENCE) for a in watch.look(status(residue=2, expected=12), now)]
    assert [a.kind for a in alarms] == ["accounting"]
    assert alarms[0].evidence["expected"] == 12


def test_other_parts() -> None:
    watch = Watch()
    sick = status() | {
        "stages": {"power": {"state": "broken", "error": "KeyError: 1"}},
        "sinks": {"zenoh": {"state": "down", "error": "no route"}},
        "recorder": {"state": "disk full", "problem": "no space left", "drops": {"/raw/arm/rtde": 7}},
    }
    kinds = {a.kind for now in range(PATIENCE) for a in watch.look(sick, now)}
    assert kinds == {"stage_broken", "sink_down", "recorder"}
