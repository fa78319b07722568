"""``cellwatt demo``, the whole chain as a user sees it first."""

from __future__ import annotations

import json
from typing import Any

import pytest

from cellwatt.demo.fault import JOINT
from tests.system.running import cellwatt

pytestmark = pytest.mark.system


async def demo(*words: str) -> Any:
    code, out, err = await cellwatt("demo", *words, "--json")
    result = json.loads(out)
    assert code == (0 if result["ok"] else 1), err
    return result


@pytest.mark.slow
@pytest.mark.timeout(240)
async def test_demo_names_the_joint_and_loses_nothing_it_is_sent() -> None:
    result = await demo("--seconds", "20")
    assert result["fault"]["named_joint"] == JOINT, result
    assert result["fault"]["early_alarms"] == 0
    assert set(result["sources"]) == {"arm", "board", "positioner", "mains"}
    assert all(s["residue"] == 0 for s in result["sources"].values())
    # Streams lose nothing however busy the machine is; polls that fall due while it stands still are missed, and told.
    assert result["sources"]["arm"]["lost"] == result["sources"]["board"]["lost"] == 0
    assert not [p for p in result["problems"] if "subscriber" in p], result["problems"]
    assert result["predictions"] > 10
    # The emulated analyzer gives means over 100 ms; where polls of the arm are missed, motion with holes tells less.
    assert result["meter"] is not None or result["sources"]["positioner"]["lost"]
    if result["meter"] is not None:
        assert result["meter"]["window_s"] == pytest.approx(0.1, abs=0.03)
