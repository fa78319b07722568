"""The layout file: what the app documents, for the demo's cell and for any other."""

from __future__ import annotations

import json
from dataclasses import fields
from typing import Any

import foxglove.layouts as documented
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cellwatt.config import load
from cellwatt.frames import FrameChannel, Layout
from cellwatt.outlets.foxglove import layout_for, layout_of
from cellwatt.outlets.foxglove.arm import WORLD
from cellwatt.outlets.foxglove.topics import LOG, SCENE
from cellwatt.outlets.foxglove.translate import FrameMessages
from tests.daemon.outlets.foxglove.cell import UNITS
from tests.daemon.outlets.zenoh.processes import ROOT

PACKAGED = ROOT / "daemon/cellwatt/outlets/foxglove/layout.json"
PANELS = {
    "Plot": documented.PlotConfig,
    "3D": documented.ThreeDeeConfig,
    "RosOut": documented.LogConfig,
    "StateTransitions": documented.StateTransitionsConfig,
    "Table": documented.TableConfig,
    "RawMessages": documented.RawMessagesConfig,
}
NESTED = {
    "cameraState": documented.ThreeDeeCameraState(),
    "scene": documented.BaseRendererSceneSettings(),
}
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
    assert packaged["configById"]["3D!arms"]["followTf"] == WORLD
    assert packaged["configById"]["3D!arms"]["topics"] == {SCENE: {"visible": True}}


def test_every_panel_is_shown_once() -> None:
    layout = layout_for(UNITS, ["power"])
    assert sorted(shown(layout["layout"])) == sorted(layout["configById"])


@pytest.mark.parametrize("panel", layout_for(UNITS, ["power"])["configById"])
def test_every_setting_is_one_that_the_library_documents(panel: str) -> None:
    config = layout_for(UNITS, ["power"])["configById"][panel]
    known = PANELS[panel.partition("!")[0]]()._to_dict()
    assert config.keys() - {TITLE} <= known.keys()
    series = {"Plot": documented.PlotSeries, "StateTransitions": documented.StateTransitionsSeries}
    for path in config.get("paths", ()):
        assert path.keys() <= series[panel.partition("!")[0]]()._to_dict().keys()
        assert path["timestampMethod"] == "receiveTime"
    for name, about in NESTED.items():
        assert config.get(name, {}).keys() <= about._to_dict().keys()
    for layer in config.get("layers", {}).values():
        assert layer.keys() <= documented.BaseRendererGridLayerSettings()._to_dict().keys()
    assert fields(PANELS[panel.partition("!")[0]])


def test_measured_stands_beside_predicted_power() -> None:
    layout = layout_for(
        {"arm.bus.power": "W", "arm.joint_1.position": "rad", "mains.phase_1.power": "W"}, ["a", "b/heat"]
    )
    paths = [(p["value"], p["enabled"]) for p in layout["configById"]["Plot!power"]["paths"]]
    assert paths == [
        ("/frame.arm_bus_power", True),
        ('/prediction{model=="a"}.outputs.power[-1]', True),
        ('/prediction{model=="a"}.outputs.power[0]', False),
        ('/prediction{model=="b"}.outputs.heat[-1]', True),
        ('/prediction{model=="b"}.outputs.heat[0]', False),
    ]


def test_the_demos_own_file_gives_its_channels_and_its_model() -> None:
    layout = layout_of(load(ROOT / "examples" / "demo.yaml", {}))
    values = {p["value"] for config in layout["configById"].values() for p in config.get("paths", ())}
    packaged = json.loads(PACKAGED.read_text())["configById"].values()
    assert values > {p["value"] for config in packaged for p in config.get("paths", ())}
    assert "/frame.mains_supply_power" in values


@pytest.mark.parametrize(
    ("channels", "panels"),
    [
        (["arm.joint_1.torque", "arm.joint_1.current"], {"Joint torques [Nm]": ["arm.joint_1.torque"]}),
        (["arm.joint_1.current", "arm.bus.current"], {"Joint currents [A]": ["arm.joint_1.current"]}),
        (["arm.joint_1.target_torque"], {"Target torques [Nm]": ["arm.joint_1.target_torque"]}),
        (
            ["arm.joint_1.current", "arm.joint_1.target_torque", "other.joint_1.torque"],
            {"Joint torques [Nm]": ["other.joint_1.torque"], "Joint currents [A]": ["arm.joint_1.current"]},
        ),
        (["board.supply.power"], {}),
    ],
)
def test_efforts_are_the_best_that_each_arm_tells(channels: list[str], panels: dict[str, list[str]]) -> None:
    layout = layout_for(dict.fromkeys(channels, "Nm"), [])
    plots = [config for name, config in layout["configById"].items() if name.startswith("Plot!")][2:]
    assert {plot[TITLE]: [path["label"] for path in plot["paths"]] for plot in plots} == panels
    assert sorted(shown(layout["layout"])) == sorted(layout["configById"])


def test_states_are_told_of_each_arm() -> None:
    layout = layout_for({"arm.joint_1.position": "rad", "positioner.joint_1.position": "rad"}, [])
    values = [p["value"] for p in layout["configById"]["StateTransitions!states"]["paths"]]
    assert values[0] == "/health.status.state"
    assert values[3:] == ['/interval{source=="positioner"}.number', '/task{source=="positioner"}.name']


NAMES = st.lists(
    st.builds("{}.{}".format, st.sampled_from(["arm", "a-b", "a_b"]), st.sampled_from(["supply.power", "bus.power"])),
    unique=True,
)


@given(NAMES)
def test_paths_are_the_fields_of_the_frames_whatever_the_sources_are_called(names: list[str]) -> None:
    layout = Layout(tuple(FrameChannel(name, "W", "continuous", "linear") for name in names), 50.0)
    known = {f"/frame.{field}" for field in FrameMessages(layout).fields}
    panel = layout_for(dict.fromkeys(names, "W"), [])["configById"]["Plot!power"]
    assert {p["value"] for p in panel["paths"]} == known
