"""The daemon's own alarms: raised once after patience, cleared once, never flapping."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from cellwatt.results import Alarm
from cellwatt.runtime.health import colour
from cellwatt.runtime.troubles import PATIENCE, Monitor


def status(**source: Any) -> dict[str, Any]:
    healthy = {
        "state": "ok",
        "error": None,
        "identity": {"maker": "M", "model": "N"},
        "since_s": 5.0,
        "residue": 0,
        "expected": 10,
        "received": 10,
        "missed": {},
        "dropped": {},
        "streams": {},
        "clocks": {},
        "counters": {},
        "anomalies": [],
        "forgeries": [],
    }
    return {"sources": {"arm": healthy | source}, "stages": {}, "sinks": {}, "recorder": recorder()}


def recorder(**figures: Any) -> dict[str, Any]:
    return {"state": "ok", "problem": "", "overdue": 0.0, "drops": {}, **figures}


def looked_at(watch: Monitor, seconds: int, source: Callable[[int], dict[str, Any]]) -> list[Alarm]:
    """Looks once a second at a source that has been up for long, whose figures are those of each second."""
    return looks(watch, range(seconds), lambda second: status(**({"since_s": 100.0 + second} | source(second))))


def looks(watch: Monitor, seconds: range, at: Callable[[int], dict[str, Any]]) -> list[Alarm]:
    """Looks once a second at a cell whose health is that of each second."""
    return [alarm for second in seconds for alarm in watch.look(at(second), second * 10**9)]


def stream(samples: float) -> dict[str, Any]:
    return {"rtde": {"nominal_hz": 50.0, "samples": round(samples)}}


DOWN = {"state": "retrying", "error": "no device answers at 192.0.2.1:30004"}


def test_down_source_is_raised_once_and_cleared_once() -> None:
    watch = Monitor()
    given = [watch.look(status(**DOWN), now) for now in range(10)]
    alarms = [a for each in given for a in each]
    assert [a.kind for a in alarms] == ["source_down"]
    assert given[PATIENCE - 1] == alarms
    assert "192.0.2.1:30004" in alarms[0].statement
    after = looks(watch, range(10, 40), lambda _: status())
    assert [(a.id, a.active, a.statement) for a in after] == [
        (alarms[0].id, False, "Resolved: source arm responds again.")
    ]


def test_a_source_that_comes_and_goes_is_one_alarm() -> None:
    """Down for 5 s and back for 6 s, five times: what a loose plug does."""
    said = looked_at(Monitor(), 55 + 20, lambda second: DOWN if second % 11 < 5 and second < 55 else {})
    assert [(a.active, a.since) for a in said] == [(active, (PATIENCE - 1) * 10**9) for active in (True, False)]
    assert said[-1].time >= (50 + 14) * 10**9
    said = looked_at(Monitor(), 240, lambda second: DOWN if second % 100 < 5 else {})
    assert [a.active for a in said] == [True, False, True, False, True, False]


def test_an_alarm_of_a_stage_is_not_the_daemons_to_clear() -> None:
    theirs = Alarm("soldering", "recorder", "warning", True, 1, 2, "The reflow recorder has stopped.", stage="oven")
    assert looked_at(Monitor([theirs]), 5, lambda _: {}) == []


def test_other_parts() -> None:
    watch = Monitor()
    sick = status() | {
        "stages": {"power": {"state": "broken", "error": "KeyError: 1"}},
        "sinks": {"zenoh": {"state": "down", "error": "no route"}, "page": {"state": "starting", "error": None}},
        "recorder": {"state": "disk full", "problem": "no space left", "drops": {"/raw/arm/rtde": 7}, "overdue": 0.0},
    }
    kinds = [a.kind for now in range(PATIENCE) for a in watch.look(sick, now)]
    assert sorted(kinds) == ["recorder", "sink_down", "stage_broken"], "an outlet that still starts is no trouble"


def test_a_source_that_gives_less_than_it_declares_is_told_with_what_it_missed() -> None:
    watch = Monitor()
    alarms = looked_at(watch, 20, lambda s: {"streams": stream(20 * s), "missed": {"slow answers": 30 * s}})
    assert [(a.kind, a.source) for a in alarms] == [("source_slow", "arm")]
    assert alarms[0].statement.startswith("Source arm delivers 20 of 50 samples a second (rtde); lost: ")
    assert alarms[0].evidence["lost"].keys() == {"slow answers"}
    assert [t.kind for t in watch.troubles] == ["source_slow"]


def test_a_source_as_declared_is_not_told_nor_one_that_has_just_come_up() -> None:
    assert looked_at(Monitor(), 20, lambda s: {"streams": stream(48 * s)}) == []
    assert looked_at(Monitor(), 6, lambda s: {"streams": stream(10 * s), "since_s": s - 1.0}) == []
    assert looked_at(Monitor(), 20, lambda s: {"streams": {"io": {"nominal_hz": 0.0, "samples": 0}}}) == []


def test_a_clock_that_is_not_followed_is_told() -> None:
    alarms = looked_at(Monitor(), 5, lambda _: {"clocks": {"rtde": {"bound_ns": 5_000_000_000, "resets": 0}}})
    assert [a.kind for a in alarms] == ["clock_unsure"]
    assert "wrong by up to 5 s" in alarms[0].statement
    assert looked_at(Monitor(), 5, lambda _: {"clocks": {"rtde": {"bound_ns": 900_000, "resets": 0}}}) == []


def strange(figures: Callable[[int], dict[str, int]], **names: list[str]) -> list[Alarm]:
    """Looks at a source with 50 samples a second, and its counters at each second."""
    return looked_at(Monitor(), 40, lambda s: {"expected": 50 * s, "counters": figures(s), **names})


def test_what_is_no_sample_is_told_with_its_reasons_where_there_is_much_of_it() -> None:
    names = ["duplicates", "malformed"]
    alarms = strange(lambda s: {"duplicates": 100 * s, "malformed": 3 * s, "retries": 99 * s}, anomalies=names)
    assert [(a.kind, a.source, a.severity) for a in alarms] == [("source_strange", "arm", "warning")]
    assert " duplicates, " in alarms[0].statement and " 9 malformed in the last 3 s. The line" in alarms[0].statement
    assert alarms[0].evidence.keys() == set(names)
    assert strange(lambda s: {"duplicates": s // 3}, anomalies=["duplicates"]) == []


def test_one_forgery_is_told_and_over_when_no_more_come() -> None:
    alarms = strange(lambda s: {"contradicting answers": min(s, 1)}, forgeries=["contradicting answers"])
    assert [(a.kind, a.active) for a in alarms] == [("source_strange", True), ("source_strange", False)]
    assert "Source arm: 1 contradicting answers in the last " in alarms[0].statement
    assert alarms[0].statement.endswith("Another sender uses the device's name.")


def test_an_alarm_states_the_reason_of_today_at_most_once_a_minute() -> None:
    def outlet(second: int) -> dict[str, Any]:
        reason = "Connection refused" if second < 10 else f"not authorized {second}"
        return status() | {"sinks": {"mqtt": {"state": "down", "error": reason}}}

    alarms = looks(Monitor(), range(150), outlet)
    assert [a.statement.partition(": ")[2] for a in alarms] == [
        "Connection refused",
        "not authorized 62",
        "not authorized 122",
    ]
    assert {a.since for a in alarms} == {alarms[0].since}


def early(name: str, value: object, after: object) -> Callable[[int], dict[str, Any]]:
    return lambda second: {name: value if second < 5 else after}


def slow_stage(second: int) -> dict[str, Any]:
    return {"stages": {"power": {"state": "ok", "error": None, "dropped": 7 * min(second, 5)}}}


def slow_process(second: int) -> dict[str, Any]:
    tell = {"down": False, "silent_s": 0.1, "restarts": 0, "skipped_bytes": 1000 * min(second, 19)}
    return {"processes": {"tell": tell}}


def blank(second: int) -> dict[str, Any]:
    tags = {"nominal_hz": 10.0, "samples": 10 * (second + 100), "blank": ["joint_1.torque"] if second < 5 else []}
    return status(since_s=100.0 + second, streams={"tags": tags})


def slow_disk(second: int) -> dict[str, Any]:
    """It takes a share of what is given, without an error."""
    return {"recorder": recorder(drops={"/raw/arm/rtde": 30 * min(second, 5), "/frame": 3})}


def hung_disk(second: int) -> dict[str, Any]:
    """A write that does not return: nothing is refused before the queue is full."""
    return {"recorder": recorder(overdue=second - 2.0 if second < 20 else 0.0)}


@pytest.mark.parametrize(
    ("kind", "severity", "figures", "says"),
    [
        (
            "settings_refused",
            "warning",
            early("refused_settings", "c.yaml:1: no YAML", ""),
            "c.yaml:1: no YAML. The old",
        ),
        ("pc_clock", "warning", early("utc_error_ms", 3_600_000.0, 0.5), "3600.0 s ahead of this PC's"),
        ("pc_clock", "warning", early("utc_error_ms", -1500.0, 0.5), "1.5 s behind"),
        ("recorder", "error", slow_disk, "90 messages were not recorded in the last 10 s. The disk"),
        ("recorder", "error", hung_disk, "nothing was written for 13 s. The disk"),
        ("stage_slow", "warning", slow_stage, "Stage power is too slow: "),
        ("process_slow", "error", slow_process, "missing in the record"),
        ("source_blank", "warning", blank, "sends no values for arm.joint_1.torque"),
    ],
)
def test_a_condition_is_told_once_and_over_when_it_is(
    kind: str, severity: str, figures: Callable[[int], dict[str, Any]], says: str
) -> None:
    alarms = looks(Monitor(), range(40), lambda second: status() | figures(second))
    assert [(a.kind, a.severity, a.active) for a in alarms] == [(kind, severity, active) for active in (True, False)]
    assert says in alarms[0].statement and alarms[1].statement.startswith("Resolved: ")


def test_a_file_that_was_moved_away_is_no_slow_disk() -> None:
    moved = {"files": 1, "messages": 500, "reason": "the file was moved away"}
    for displaced, kinds in ((moved, {"record_displaced"}), ({}, {"recorder"})):
        figures = recorder(drops={"/frame": 500}, displaced=displaced)
        watch = Monitor()
        said = looks(watch, range(6), lambda s, after=figures: status() | {"recorder": after if s else recorder()})
        assert {a.kind for a in said} == kinds
        assert colour(status(), watch.troubles) == ("red" if kinds == {"recorder"} else "amber")


def test_an_alarm_of_a_part_that_a_reload_removed_is_withdrawn_not_resolved() -> None:
    def at(second: int) -> dict[str, Any]:
        parts = {
            "sinks": {"mqtt": {"state": "down", "error": "no broker"}},
            "stages": {"power": {"state": "broken", "error": "KeyError: 1"}},
        }
        return status(**DOWN) | (parts if second < 10 else {"sources": {}})

    over = {a.id: a.statement for a in looks(Monitor(), range(40), at) if not a.active}
    assert over == {
        "source_down:arm": f"Withdrawn, as arm is no longer part of the cell: Source arm is down: {DOWN['error']}",
        "sink_down:mqtt": "Withdrawn, as mqtt is no longer part of the cell: Outlet mqtt is down: no broker",
        "stage_broken:power": "Withdrawn, as power is no longer part of the cell: Stage power failed: KeyError: 1",
    }


def test_processes_that_the_pc_does_not_let_run_are_one_warning_not_down() -> None:
    def waiting(*names: str) -> dict[str, Any]:
        usual = {"down": False, "restarts": 0, "silent_s": 5.2}
        return status() | {"processes": {n: usual | {"starved": n in names} for n in ("align", "judge power", "tell")}}

    watch = Monitor()
    alarms = looks(watch, range(10), lambda _: waiting("align", "judge power"))
    assert [(a.id, a.severity) for a in alarms] == [("pc_slow:pc", "warning")]
    assert alarms[0].statement.endswith("waited for a processor: align for 5 s, judge power for 5 s.")
    alarms = looks(watch, range(10, 30), lambda _: waiting())
    assert [(a.id, a.active, a.statement) for a in alarms] == [
        ("pc_slow:pc", False, "Resolved: this PC keeps up again.")
    ]


def test_what_a_busy_pc_brings_about_is_no_fault_of_device_or_stage() -> None:
    def at(second: int, **process: Any) -> dict[str, Any]:
        told = status(since_s=100.0, streams=stream(40 * second), missed={"host stalled": 10 * second})
        stages = {"faults": {"state": "ok", "dropped": 50 * second}}
        return told | {
            "stages": stages,
            "processes": {"judge": {"down": False, "restarts": 0, "silent_s": 6.0, **process}},
        }

    alarms = looks(Monitor(), range(20), lambda s: at(s, starved=True))
    assert [(a.kind, a.severity) for a in alarms] == [("pc_slow", "warning")]
    alarms = looks(Monitor(), range(20), at)
    assert sorted((a.kind, a.severity) for a in alarms) == [("pc_slow", "warning"), ("stage_slow", "warning")]
    assert next(a for a in alarms if a.kind == "pc_slow").statement.endswith(
        "the programs that run on it. Affected: source arm."
    )


def test_a_device_that_answers_and_gives_no_number_is_an_alarm() -> None:
    starting = {"state": "starting", "streams": {}}
    waits = looked_at(Monitor(), 20, lambda second: starting | {"since_s": float(second)})
    assert [(a.kind, a.severity, a.time // 10**9) for a in waits] == [("source_silent", "error", 10 + PATIENCE - 1)]
    assert waits[0].statement.startswith("Source arm answers, but has sent no values for 12 s.")
    mute = starting | {"identity": None}
    assert not looked_at(Monitor(), 20, lambda second: mute | {"since_s": float(second)}), "it does not answer yet"
    (hangs,) = looked_at(Monitor(), 150, lambda second: mute | {"since_s": float(second)})
    assert hangs.statement.startswith("Source arm has neither connected nor failed for 122 s.")


def test_what_is_sent_on_change_or_seldom_may_not_have_come_yet() -> None:
    for nominal, since, raised in ((0.0, 1000.0, 0), (0.01, 299.0, 0), (0.01, 301.0, 1), (5.0, 9.0, 0)):
        figures = {"nominal_hz": nominal, "samples": 0, "blank": ["valve.state"]}
        streams = {"streams": {"tags": figures}, "since_s": since}
        kinds = {a.kind for a in looked_at(Monitor(), PATIENCE, lambda _, streams=streams: streams)}
        assert kinds == ({"source_blank"} if raised else set())
