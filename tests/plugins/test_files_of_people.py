"""One wrong file of each kind: one line with file, line and column, or file and key if a command wrote the file."""

# ruff: noqa: E501  # a case a line

from __future__ import annotations

import re
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from cellwatt.config import load
from cellwatt.errors import CellwattError
from cellwatt_drivers.can_sensor.sensor_map import load_decodings
from cellwatt_drivers.modbus_meter.meter_map import chosen_map
from cellwatt_plugins.energy.known import load_known
from cellwatt_plugins.explain.model import load_model
from cellwatt_plugins.faults import reference
from cellwatt_plugins.faults.api import _known
from cellwatt_plugins.faults.paper import equation
from cellwatt_plugins.robot.description import load_robot

ROBOT = "robot: a\nurdf: a.urdf\njoints:\n- name: j1\n"
ARM: Any = SimpleNamespace(joints=1)
CASES: dict[str, tuple[str, Callable[[Path], object], str, str]] = {
    "cell": ("cell.yaml", load, "site: a\ncell: b\nsourcs: {}\n", "3:1: sourcs: unknown key 'sourcs'; did you mean 'sources'"),
    "robot": ("robot.yaml", load_robot, f"{ROBOT}  gear_ratio: none\n", "5:15: joints[0].gear_ratio: found 'none', expected a number"),
    "misspelt": ("robot.yaml", load_robot, f"{ROBOT}  torque_constnat: 1\n", "5:3: joints[0].torque_constnat: unknown key 'torque_constnat'; did you mean 'torque_constant'"),
    "twice": ("robot.yaml", load_robot, f"{ROBOT}robot: b\n", "5:1: robot: the key 'robot' is given twice, first at line 1 column 1"),
    "tolerances": ("robot.yaml", load_robot, f"{ROBOT}tolerances: {{link: -1}}\n", "5:20: tolerances.link: found -1, expected a value above 0"),
    "supply": ("robot.yaml", lambda path: load_robot(path, ["winding_resistance"]), f"{ROBOT}  torque_constant: 1\n", "4:3: joints[0].winding_resistance: j1 has no winding_resistance: add it"),
    "outline": ("robot.yaml", load_robot, f"{ROBOT}capsules:\n- {{link: 1, from: [0, 0, 0], to: [0, 0, 1], radius: 0}}\n", "6:53: capsules[0].radius: found 0, expected a value above 0"),
    "--robot": ("arm.yaml", lambda path: _known(str(path)), "robot: 7\n", "1:8: robot: found 7, expected text; write it in quotes"),
    "energy.json": ("energy.json", lambda path: load_known(path, ARM), '{"robot": "a",\n "fixed": 5}', " fixed: found 5, expected settings (key: value) (and 9 more); if it is of an earlier cellwatt, run `cellwatt disaggregate`"),
    "reference": ("reference.yaml", reference.load, "cellwatt_reference: 1\nrobot: a\narm: a\npower: p\njoints: 0\ntasks: []\n", " joints: found 0, expected at least 1"),
    "equation": ("equation.yaml", equation.load, "cellwatt_power_equation: 1\npower: p\norder: 2\nduration: 1\nrms: []\nK: 1\np: []\nr: []\n", " order: order 2 needs as many p and r"),
    "model": ("model.yaml", load_model, "format: 1\nrobot: {robot: a, urdf: a, joints: [{name: a}]}\neffects: []\nretuned: {}\n", " format: found 1: this cellwatt reads version 2: run `cellwatt explain` again"),
    "meter": ("meter.yaml", partial(chosen_map, None), "title: a\nvalues: 5\n", "2:9: values: found 5, expected settings (key: value)"),
    "sensor": ("sensor.yaml", partial(load_decodings, None), "streams: 5\n", "1:10: streams: found 5, expected "),
}  # fmt: skip


@pytest.mark.parametrize(("name", "read", "text", "message"), CASES.values(), ids=CASES)
def test_a_mistake_has_its_place(
    tmp_path: Path, name: str, read: Callable[[Path], object], text: str, message: str
) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(CellwattError) as caught:
        read(path)
    assert f"{path}:{message}" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "read", "message"), {name: (name, read, said) for name, read, _, said in CASES.values()}.values()
)
@pytest.mark.parametrize("text", ["a: [1,\n  2\nb: 3\n", "\n\n- 1\n", "", "a:\n\t- 1\n"])
def test_what_is_no_such_file_has_its_place(
    tmp_path: Path, name: str, read: Callable[[Path], object], message: str, text: str
) -> None:
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(CellwattError) as caught:
        read(path)
    place = "" if message.startswith(" ") else r":\d+:\d+"
    fault = "not valid YAML|found a list|the file is empty|expected settings"
    assert re.match(rf"{re.escape(str(path))}{place}: ({fault})", str(caught.value))
    assert len(str(caught.value).splitlines()) == 1
