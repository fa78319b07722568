"""What the demo calls a problem."""

from __future__ import annotations

from typing import Any

import pytest

from cellwatt.demo import fault
from cellwatt.demo.seen import Seen
from cellwatt.demo.summary import problems_of, sources_of


def source(rate: float, stalled: int) -> dict[str, Any]:
    stream = {"nominal_hz": 50.0, "rate_hz": rate, "samples": 1000, "delivered": 1000, "before_subscriber": 0}
    return {
        "lost": 0,
        "residue": 0,
        "expected": 1000,
        "host_stalled": stalled,
        "kept_s": 0.0,
        "streams": {"position": stream},
    }


@pytest.mark.parametrize(
    ("rate", "stalled", "well"), [(49.5, 0, True), (48.0, 0, False), (48.0, 30, True), (46, 30, False)]
)
def test_polls_that_fell_due_while_this_pc_stood_still_are_no_fault_of_the_rate(
    rate: float, stalled: int, well: bool
) -> None:
    seen = Seen(status={"frames": {"count": 0}})
    assert (problems_of(seen, {"arm": source(rate, stalled)}, ["arm"], 0) == []) is well


@pytest.mark.parametrize(("stalled", "late", "kept", "lost"), [(0, 2, 0.0, 2), (1, 7, 0.04, 3), (30, 8, 0.1, 0)])
def test_an_answer_is_late_where_this_pc_kept_the_emulator_from_running(
    stalled: int, late: int, kept: float, lost: int
) -> None:
    missed = {"host stalled": stalled, "slow answers": late}
    figures = {"nominal_hz": 50.0, "rate_hz": 50.0, "jitter_p50_ms": 0.0, "jitter_p99_ms": 0.0, "samples": 900}
    counts = {"expected": 1000, "received": 900, "missed": missed, "dropped": {}, "residue": 0}
    seen = Seen(status={"sources": {"arm": counts | {"streams": {"position": figures}}}})
    assert sources_of(seen, {"arm": kept})["arm"]["lost"] == lost


@pytest.mark.parametrize(("delay", "busy", "well"), [(0.5, False, True), (3.0, False, False), (3.0, True, True)])
def test_an_alarm_may_be_late_on_a_pc_that_stood_still(delay: float, busy: bool, well: bool) -> None:
    told = {"joint": 3, "named_joint": 3, "early_alarms": 0, "delay_s": delay, "interval_s": 0.7}
    assert (fault.problems_of(told, busy=busy) == []) is well
