"""What the demo calls a problem."""

from __future__ import annotations

from typing import Any

import pytest

from cellwatt.demo.seen import Seen
from cellwatt.demo.summary import problems_of


def source(rate: float, stalled: int) -> dict[str, Any]:
    stream = {"nominal_hz": 50.0, "rate_hz": rate, "samples": 0, "delivered": 0, "before_subscriber": 0}
    return {"lost": 0, "residue": 0, "expected": 1000, "host_stalled": stalled, "streams": {"position": stream}}


@pytest.mark.parametrize(
    ("rate", "stalled", "well"), [(49.5, 0, True), (48.0, 0, False), (48.0, 30, True), (46, 30, False)]
)
def test_polls_that_fell_due_while_this_pc_stood_still_are_no_fault_of_the_rate(
    rate: float, stalled: int, well: bool
) -> None:
    seen = Seen(status={"frames": {"count": 0}})
    assert (problems_of(seen, {"arm": source(rate, stalled)}, ["arm"], 0) == []) is well
