from dataclasses import asdict
from typing import Any

from cellwatt.live.site import site, summary
from cellwatt.live.state import LiveCell
from cellwatt.live.view import Look
from cellwatt.subscriber import Health
from tests.daemon.live.cells import START, alarm, source, status


def standing(*severities: str) -> list[Any]:
    cell = LiveCell()
    for severity in severities:
        cell.take(alarm(f"of {severity}", severity=severity))
    return [asdict(standing.alarm) for standing in cell.alarms.up]


SOURCES = {"arm": source(lost=3), "board": source("retrying", "gone")}
CELLS = {
    "weld-1": Health(1, START, {}, status()),
    "weld-2": Health(1, START, {}, status(state="amber", sources=SOURCES, alarms=standing("info", "error", "warning"))),
    "weld-3": None,
}


def test_each_cell_has_its_line() -> None:
    lines = [" ".join(line.plain.split()) for line in site(CELLS, Look(width=120))]
    assert lines == [
        "cell state at sources received lost alarms the gravest",
        "weld-1 ● green 22:13:20 2/2 2000 0 0",
        "weld-2 ● amber 22:13:20 1/2 1997 3 3 of error is wrong.",
        "weld-3 heard, does not answer",
    ]
    assert [line.plain for line in site({}, Look())] == ["no cell is heard"]
    assert all(line.cell_len <= 60 for line in site(CELLS, Look(width=60)))


def test_a_cell_in_figures() -> None:
    told = summary("weld-2", CELLS["weld-2"])
    assert (told["sources"], told["sources_ok"], told["received"], told["lost"]) == (2, 1, 1997, 3)
    assert [a["severity"] for a in told["alarms"]] == ["info", "error", "warning"]
    assert summary("weld-3", None)["state"] is None
