"""What the demo calls a problem."""

from __future__ import annotations

from typing import Any

import pytest

from cellwatt.demo import fault
from cellwatt.demo.cells import SOURCES
from cellwatt.demo.seen import Seen
from cellwatt.demo.summary import problems_of, sources_of, summary


def seen(rate: float = 50.0, **changed: object) -> Seen:
    """What a subscriber saw of a run in which a joint moved; ``changed`` figures of each source."""
    stream = {"nominal_hz": 50.0, "rate_hz": rate, "jitter_p50_ms": 0.1, "jitter_p99_ms": 0.2, "samples": 1000}
    counts = {"expected": 1000, "received": 1000, "missed": {}, "dropped": {}, "residue": 0}
    source = {**counts, "streams": {"s": stream}, **changed}
    told = Seen(status={"sources": dict.fromkeys(SOURCES, source), "frames": {"count": 0}}, predictions=9)
    for name in SOURCES:
        told.add({"kind": "raw", "topic": f"raw/{name}/s", "sequence": 0, "content": {"count": 1000}})
    told.add({"kind": "interval", "content": {"closed": True, "moving": [3], "start": 10e9, "end": 10.7e9}})
    return told


@pytest.mark.parametrize(
    ("rate", "stalled", "well"), [(49.5, 0, True), (48.0, 0, False), (48.0, 30, True), (46, 30, False)]
)
def test_polls_that_fell_due_while_this_pc_stood_still_are_no_fault_of_the_rate(
    rate: float, stalled: int, well: bool
) -> None:
    told = seen(rate, missed={"host stalled": stalled})
    assert (problems_of(told, sources_of(told, {}), 0) == []) is well


@pytest.mark.parametrize(("stalled", "late", "kept", "lost"), [(0, 2, 0.0, 2), (1, 7, 0.04, 3), (30, 8, 0.1, 0)])
def test_an_answer_is_late_where_this_pc_kept_the_emulator_from_running(
    stalled: int, late: int, kept: float, lost: int
) -> None:
    told = seen(missed={"host stalled": stalled, "slow answers": late})
    assert sources_of(told, {"arm": kept})["arm"]["lost"] == lost


@pytest.mark.parametrize(("delay", "busy", "well"), [(0.5, False, True), (3.0, False, False), (3.0, True, True)])
def test_an_alarm_may_be_late_on_a_pc_that_stood_still(delay: float, busy: bool, well: bool) -> None:
    told = {"joint": 3, "named_joint": 3, "early_alarms": 0, "delay_s": delay, "interval_s": 0.7}
    assert (fault.problems_of(told, busy=busy) == []) is well


@pytest.mark.parametrize(
    ("joint", "at", "changed", "exit_code", "problem"),
    [
        (3, 10.4, {}, 0, ""),
        (2, 10.4, {}, 0, "names joint 2"),
        (3, 9.0, {}, 0, "before the fault"),
        (3, 10.4, {"missed": {"gap": 1}, "received": 999}, 0, "1 samples lost"),
        (3, 10.4, {"residue": 4}, 0, "4 not accounted"),
        (3, 10.4, {}, 1, "exit code 1"),
    ],
)
def test_summary_sees_what_is_wrong(
    joint: int, at: float, changed: dict[str, Any], exit_code: int, problem: str
) -> None:
    told = seen(**changed)
    content = {"kind": "joint_fault", "severity": "error", "joint": joint, "active": True, "statement": "…"}
    told.add({"kind": "alarm", "received": at * 1e9, "content": content})
    problems = summary(told, {}, 10.0, exit_code)["problems"]
    assert problem in "; ".join(problems)
    assert bool(problems) == bool(problem)


def test_summary_misses_samples_and_alarms_that_did_not_come() -> None:
    told = seen()
    told.samples["raw/arm/s"] -= 1
    problems = "; ".join(summary(told, {}, 10.0, 0)["problems"])
    assert "999 at the subscriber" in problems
    assert "no alarm" in problems
