"""The layout file: what the app documents, for the demo's cell and for any other."""

from __future__ import annotations

import json
from typing import Any

import pytest

from cellwatt.config import load
from cellwatt.outlets.foxglove import layout_for, layout_of
from cellwatt.outlets.foxglove.topics import LOG
from tests.daemon.outlets.foxglove.cell import UNITS
from tests.daemon.outlets.zenoh.processes import ROOT

PACKAGED = ROOT / "daemon/cellwatt/outlets/foxglove/layout.json"
TITLE = "foxglovePanelTitle"


def shown(tree: Any) -> list[str]:
    """Panels in the tree of the layout, and its splits checked."""
    if isinstance(tree, str):
        return [tree]
    assert tree["direction"] in ("row", "column")
    assert 0 < tree["splitPercentage"] < 100
    return [*shown(tree["first"]), *shown(tree["second"])]


def test_the_packaged_file_is_that_of_the_demo() -> None:
    packaged = json.loads(PACKAGED.read_text())
    assert packaged == layout_for(UNITS, ["power"])
    assert packaged["configById"]["RosOut!log"]["topicToRender"] == LOG


def test_the_demos_own_file_gives_its_channels_and_its_model() -> None:
    layout = layout_of(load(ROOT / "examples" / "demo.yaml", {}))
    values = {p["value"] for config in layout["configById"].values() for p in config.get("paths", ())}
    packaged = json.loads(PACKAGED.read_text())["configById"].values()
    assert values > {p["value"] for config in packaged for p in config.get("paths", ())}
    assert "/frame.mains_supply_power" in values


@pytest.mark.parametrize(
    ("channels", "panels"),
    [
        (
            ["arm.joint_1.current", "arm.bus.current", "other.joint_1.torque"],
            {"Joint torques [Nm]": ["other.joint_1.torque"], "Joint currents [A]": ["arm.joint_1.current"]},
        ),
        (["arm.joint_1.target_torque"], {"Target torques [Nm]": ["arm.joint_1.target_torque"]}),
        (["board.supply.power"], {}),
    ],
)
def test_efforts_are_those_that_arms_tell(channels: list[str], panels: dict[str, list[str]]) -> None:
    layout = layout_for(dict.fromkeys(channels, "Nm"), [])
    plots = [config for name, config in layout["configById"].items() if name.startswith("Plot!")][2:]
    assert {plot[TITLE]: [path["label"] for path in plot["paths"]] for plot in plots} == panels
    assert sorted(shown(layout["layout"])) == sorted(layout["configById"])
