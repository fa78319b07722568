from dataclasses import asdict
from typing import Any

from cellwatt.live.site import line, summary
from cellwatt.live.state import LiveCell
from tests.daemon.live.cells import alarm, hear, source, status


def standing(*severities: str) -> list[Any]:
    cell = LiveCell()
    for severity in severities:
        hear(cell, alarm(f"of {severity}", severity=severity))
    return [asdict(standing.alarm) for standing in cell.alarms.up]


SOURCES = {"arm": source(lost=3), "board": source("retrying", "gone")}
CELLS = {
    "weld-1": status(),
    "weld-2": status(state="amber", sources=SOURCES, alarms=standing("info", "error", "warning")),
    "weld-3": {},
    "weld-4": status(alarms=standing("info")),
}


def test_each_cell_has_its_line() -> None:
    assert [line(summary(name, status)) for name, status in CELLS.items()] == [
        "weld-1 is green: 2 of 2 sources ok, 2000 samples received, 0 lost, no alarm",
        "weld-2 is amber: 1 of 2 sources ok, 1997 samples received, 3 lost, 3 alarms, error: of error is wrong.",
        "weld-3: heard, does not answer",
        "weld-4 is green: 2 of 2 sources ok, 2000 samples received, 0 lost, 1 alarm, info: of info is wrong.",
    ]
