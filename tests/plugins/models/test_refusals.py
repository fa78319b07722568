"""Every file that does not fit is refused in one line that names the file, what was found and what was expected."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from onnx import helper, numpy_helper

from cellwatt import CellwattError, ConfigError, ModelError
from cellwatt.config import load
from cellwatt.runtime.assemble import prepare
from cellwatt_plugins.models import Input
from cellwatt_plugins.models.metadata import encode
from cellwatt_plugins.models.power.api import train_power
from cellwatt_plugins.models.static.api import train_static
from tests.plugins.models.making import CHANNELS, Mlp, layout, metadata, save, stage, tensor
from tests.plugins.robot import planar_arm

MLP = Mlp.random(1)
TWO_ARMS = {
    "left.joint_1.position": "rad",
    "left.joint_2.position": "rad",
    "left.supply.voltage": "V",
    "right.joint_1.position": "rad",
    "right.joint_2.position": "rad",
    "meter.supply.power": "W",
}


def told(of_input: dict[str, Any], **changes: Any) -> Callable[[Path], Path]:
    """A good model with other metadata, and those of its second input."""
    document = json.loads(encode(metadata())) | changes
    document["inputs"][1] |= of_input
    return lambda path: MLP.save(path, json.dumps(document))


def content(data: bytes) -> Callable[[Path], Path]:
    return lambda path: (path.write_bytes(data), path)[1]


def identity(columns: int) -> Callable[[Path], Path]:
    nodes, shape = [helper.make_node("Identity", ["x"], ["y"])], ["n", columns]
    return lambda path: save(path, nodes, [tensor("x", shape)], [tensor("y", shape)], metadata())


def reduced(*nodes: Any, weights: Any = ()) -> Callable[[Path], Path]:
    """From x [n, 3] to y [n, 2] by nodes that take v [n, 2], the first two columns."""
    bounds = [numpy_helper.from_array(np.array([i]), n) for i, n in ((0, "from"), (2, "to"), (1, "axis"))]
    first = helper.make_node("Slice", ["x", "from", "to", "axis"], ["v"])
    y = tensor("y", ["n", 2])
    return lambda path: save(path, [first, *nodes], [tensor("x", ["n", 3])], [y], metadata(), [*bounds, *weights])


dropout = reduced(helper.make_node("RandomNormalLike", ["v"], ["r"]), helper.make_node("Add", ["v", "r"], ["y"]))
failing = reduced(
    helper.make_node("Reshape", ["v", "shape"], ["y"]), weights=[numpy_helper.from_array(np.array([7, 2]), "shape")]
)

MODELS: dict[str, tuple[Callable[[Path], Path], list[str]]] = {
    "file that is not ONNX": (content(b"site: plant-1\n"), ["onnxruntime cannot load it as ONNX", "Protobuf"]),
    "no metadata": (lambda path: MLP.save(path, None), ["no metadata", "'cellwatt'", "found none", "describe()"]),
    "newer version": (told({}, version=2, colour="red"), ["version this cellwatt reads version 1", "update cellwatt"]),
    "unknown key": (told({"units": "rad"}), ["inputs.1.units"]),
    "unit that is not SI": (told({"unit": "deg"}), ["inputs.1.unit", "rad/s"]),
    "too few columns": (identity(2), ["'x' has the shape [n, 2]", "expected [N, 3]", "3 inputs"]),
    "other window": (
        lambda path: Mlp.random(1, window=3).save(path, metadata(window=5)),
        ["'x' has the shape [n, 3, 3]", "expected [N, 5, 3]", "window 5"],
    ),
    "too many outputs": (identity(3), ["'y' has the shape [2, 3]", "expected [2, 2]", "power, heat"]),
    "dropout left on": (dropout, ["one frame alone gives", "among others", "export it for inference"]),
    "graph that fails": (failing, ["it fails on inputs of shape [2, 3]"]),
}

CELLS: dict[str, tuple[dict[str, Any], type[CellwattError], list[str]]] = {
    "other robot": ({"robot": "ur5e"}, ModelError, ["of robot 'ur10e'", "robot is 'ur5e'"]),
    "other rate": ({"grid": layout(rate=100.0)}, ModelError, ["at 50 Hz", "come at 100 Hz"]),
    "wrong unit": (
        {"grid": layout(CHANNELS | {"arm.joint_2.position": "A"})},
        ModelError,
        ["input 3 of 3 ('joint_2.position' in rad)", "arm.joint_2.position in A"],
    ),
    "unknown channel": (
        {"grid": layout({n: u for n, u in CHANNELS.items() if "voltage" not in n})},
        ModelError,
        ["input 1 of 3 ('supply.voltage' in V)", "no source", "meter.supply.power"],
    ),
    "ambiguous channel": (
        {"grid": layout(TWO_ARMS)},
        ConfigError,
        ["input 2 of 3 ('joint_1.position' in rad)", "several sources", "set source to one of left, right"],
    ),
}


def check_refused(path: Path, kind: type[CellwattError], parts: list[str], **cell: Any) -> None:
    with pytest.raises(kind) as caught:
        stage(path, **cell)
    line = str(caught.value)
    assert "\n" not in line
    assert str(path) in line
    assert [part for part in parts if part not in line] == [], line


@pytest.mark.parametrize("name", MODELS)
def test_model(tmp_path, capfd, name):
    make, parts = MODELS[name]
    check_refused(make(tmp_path / "m.onnx"), ModelError, parts)
    assert tuple(capfd.readouterr()) == ("", "")


@pytest.mark.parametrize("name", CELLS)
def test_cell(tmp_path, name):
    cell, kind, parts = CELLS[name]
    check_refused(MLP.save(tmp_path / "m.onnx", metadata()), kind, parts, **cell)


@pytest.mark.parametrize(
    ("cell", "changes"),
    [
        ({}, {}),
        ({"robot": None}, {"robot": None}),
        ({"grid": layout(rate=100.0)}, {"rate_hz": None}),
        ({}, {"rate_hz": 49.981}),
        ({"grid": layout(TWO_ARMS), "source": "left"}, {}),
    ],
)
def test_what_fits_is_taken(tmp_path, cell, changes):
    assert stage(MLP.save(tmp_path / "m.onnx", metadata(**changes)), **cell).metadata.name == "test-power"


@pytest.mark.parametrize(
    ("file", "content"),
    [
        ("robot.yaml", "robot: ur10e\n"),
        ("ur10e.xml", "<mujoco model='scene'/>"),
        ("arm.urdf", "<?xml version='1.0'?>\n<robot\n name='ur10e'></robot>"),
    ],
)
def test_a_path_to_a_description_stands_for_the_name_in_it(tmp_path, file, content):
    (tmp_path / file).write_text(content)
    assert stage(MLP.save(tmp_path / "m.onnx", metadata()), robot=file).metadata.robot == "ur10e"
    with pytest.raises(ModelError, match="of robot 'ur5e'"):
        stage(MLP.save(tmp_path / "m.onnx", metadata(robot="ur5e")), robot=file)


def test_without_onnxruntime_the_extra_is_named(tmp_path, monkeypatch):
    path = MLP.save(tmp_path / "m.onnx", metadata())
    monkeypatch.setitem(__import__("sys").modules, "onnxruntime", None)
    with pytest.raises(ConfigError, match=r"pip install 'cellwatt\[model\]'"):
        stage(path)


def test_in_a_settings_file_the_line_has_its_place(tmp_path):
    MLP.save(tmp_path / "m.onnx", metadata(inputs=tuple(Input(f"joint_{j}.position", "rad") for j in (1, 2, 3))))
    cell = tmp_path / "cell.yaml"
    cell.write_text(
        "site: plant\ncell: one\nrobot: ur5e\nsources:\n  arm: {driver: ur, host: 192.0.2.10}\n"
        "stages:\n  power: {stage: model, file: m.onnx}\nzenoh: off\n"
    )
    with pytest.raises(ConfigError) as caught:
        prepare(load(cell, {}))
    (line,) = map(str, caught.value.problems)
    assert line.startswith(f"{cell}:7:3: stages.power: the model {tmp_path / 'm.onnx'} is refused: it is of robot")
    cell.write_text(cell.read_text().replace("ur5e", "ur10e"))
    assert list(prepare(load(cell, {})).stages) == ["power"]


@pytest.mark.parametrize("train", [train_power, train_static])
def test_an_arm_with_a_linear_axis_is_refused_before_anything_is_read(tmp_path, train):
    with pytest.raises(ConfigError, match="elbow does not turn"):
        train(tmp_path / "none.parquet", robot=planar_arm.write(tmp_path, kind="prismatic"))
