"""What the segment stage says of frames that come one block at a time."""

from __future__ import annotations

from dataclasses import replace

from cellwatt_plugins.faults.trace import segmented
from tests.plugins.faults.plant import Cycle, recorded


def test_blocks_are_read_one_by_one_and_may_differ_in_their_rate():
    recording, drawn = recorded([Cycle()]), []

    def blocks():
        for block in recording:
            drawn.append(block)
            yield replace(block, layout=replace(block.layout, rate=50.0 - 0.05 * len(drawn)))

    told = segmented(blocks(), "arm", "supply.power")
    next(told)
    assert len(drawn) == 1
    assert sum(len(part) for part, _ in told) + len(drawn[0]) == sum(map(len, recording))


def test_no_blocks_give_nothing():
    assert list(segmented(iter(()), "arm", "supply.power")) == []
