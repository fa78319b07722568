"""A table that is too wide for a terminal."""

from __future__ import annotations

from cellwatt.progress import terminal

HEADER = ("source", "device", "stream", "declared", "measured", "jitter p99", "clock ±", "lost", "verdict")
ROW = ("arm", "Universal Robots UR10e 5.11", "rtde", "500 Hz", "499.9 Hz", "0.12 ms", "0.25 ms", "0", "ok")


def test_a_row_becomes_a_paragraph_that_breaks_between_values() -> None:
    assert terminal.stacked(HEADER, [ROW, ("board", "–", "–", "", "", "", "", "", "failed")], 44) == (
        "arm\n"
        "  device Universal Robots UR10e 5.11,\n"
        "  stream rtde, declared 500 Hz,\n"
        "  measured 499.9 Hz, jitter p99 0.12 ms,\n"
        "  clock ± 0.25 ms, lost 0, verdict ok\n"
        "board\n"
        "  device –, stream –, verdict failed"
    )
