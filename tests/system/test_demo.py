"""``cellwatt demo``, the whole chain as a user sees it first."""

from __future__ import annotations

import json
import sys
from typing import Any

import pytest

from cellwatt.demo import cells
from cellwatt.demo.fault import JOINT
from cellwatt.registry import available
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


@pytest.mark.slow
@pytest.mark.timeout(300)
async def test_every_driver_runs_in_one_daemon(tmp_path) -> None:
    result = await demo("--cell", "all", "--seconds", "3", "--keep", str(tmp_path))
    assert set(result["sources"]) | set(result["left_out"]) == set(available("cellwatt.drivers"))
    for name, source in result["sources"].items():
        assert source["residue"] == 0
        assert source["expected"] == source["received"] + source["lost"] + source["host_stalled"]
        assert source["received"] == sum(stream["samples"] for stream in source["streams"].values()) > 0, name
    # Streams lose nothing however busy the machine is. Polls that fall due while it stands still are missed, and so
    # are states that wait for pylibfranka, which keeps but the newest, and frames that find the CAN adapter's port
    # full; all are told.
    assert not {n for n in ("ur", "power_board") if result["sources"][n]["lost"]}, result["problems"]
    can = result["sources"]["can_sensor"]
    assert not can["dropped"] and set(can["missed"]) <= {"gap"}, can
    assert not can["lost"] or can["emulated"]["unheard"], can
    assert result["sources"]["abb"]["missed"].get("gap", 0) == 0
    assert not [p for p in result["problems"] if "subscriber" in p], result["problems"]


def test_every_driver_has_its_device() -> None:
    assert {source["driver"] for source in cells.every_driver().values()} == set(available("cellwatt.drivers"))


def test_a_driver_whose_library_is_absent_is_left_out_and_told(tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "pylibfranka", None)
    devices, lacking = cells.usable(cells.every_driver(), tmp_path)
    assert "franka" not in devices
    assert len(devices) == len(available("cellwatt.drivers")) - 1
    assert "pip install 'cellwatt[franka]'" in lacking["franka"]
