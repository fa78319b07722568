"""The joints of an arm out of its URDF, against Pinocchio and against poses worked out by hand."""

from __future__ import annotations

import json
import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from cellwatt.errors import ConfigError
from cellwatt.outlets.page.skeleton import skeleton

SIX = [f"arm.joint_{i}.position" for i in range(1, 7)]


def placed(found: dict[str, Any], positions: dict[str, float]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Rotation and place of each joint after it moved, as a browser works them out from the JSON alone."""
    frames: list[tuple[np.ndarray, np.ndarray]] = []
    for i, joint in enumerate(found["joints"]):
        assert joint["parent"] < i, "parents come first"
        turned, at = frames[joint["parent"]] if joint["parent"] >= 0 else (np.eye(3), np.zeros(3))
        at = at + turned @ np.array(joint["xyz"])
        turned = turned @ Rotation.from_euler("xyz", joint["rpy"]).as_matrix()
        q = positions.get(joint["channel"], 0.0) * joint.get("multiplier", 1.0) + joint.get("offset", 0.0)
        if joint["type"] == "revolute":
            turned = turned @ Rotation.from_rotvec(q * np.array(joint["axis"])).as_matrix()
        elif joint["type"] == "prismatic":
            at = at + turned @ np.array(joint["axis"]) * q
        frames.append((turned, at))
    return {joint["name"]: frame for joint, frame in zip(found["joints"], frames, strict=True)}


def true_frames(urdf: str, positions: dict[str, float]) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """The same by Pinocchio, with positions by joint."""
    model = pin.buildModelFromXML(urdf)
    q = pin.neutral(model)
    for name, value in positions.items():
        joint = model.joints[model.getJointId(name)]
        q[joint.idx_q : joint.idx_q + joint.nq] = [value] if joint.nq == 1 else [math.cos(value), math.sin(value)]
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    kinds = (pin.FrameType.JOINT, pin.FrameType.FIXED_JOINT)
    found = {f.name: data.oMf[i] for i, f in enumerate(model.frames) if f.type in kinds and f.name != "universe"}
    return {name: (place.rotation, place.translation) for name, place in found.items()}


def agree(found: dict, true: dict, names: list[str]) -> None:
    for name in names:
        np.testing.assert_allclose(found[name][0], true[name][0], atol=1e-9)
        np.testing.assert_allclose(found[name][1], true[name][1], atol=1e-9)


# URDF -----------------------------------------------------------------------------------------------


def joint_xml(name: str, type_: str, parent: str, child: str, more: str = "") -> str:
    limit = '<limit lower="-7" upper="7" effort="1" velocity="1"/>' if type_ in ("revolute", "prismatic") else ""
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{type_}">{ends}{limit}{more}</joint>'


def urdf_of(joints: list[str], links: list[str]) -> str:
    return f'<robot name="r">{"".join(f"<link name={chr(34)}{n}{chr(34)}/>" for n in links)}{"".join(joints)}</robot>'


NUMBERS = st.floats(-2, 2).map(lambda v: round(v, 3))
VECTORS = st.tuples(NUMBERS, NUMBERS, NUMBERS)
AXES = VECTORS.filter(lambda v: math.hypot(*v) > 0.1)
TYPES = st.sampled_from(["revolute", "continuous", "prismatic", "fixed"])
TREES = st.lists(st.tuples(TYPES, VECTORS, VECTORS, AXES, st.integers(0, 10), NUMBERS), min_size=1, max_size=8)


@settings(max_examples=60, deadline=None)
@given(TREES, st.randoms())
def test_any_tree_stands_as_pinocchio_has_it(tree, random):
    links, joints = ["base"], []
    for i, (type_, xyz, rpy, axis, parent, _) in enumerate(tree):
        texts = [" ".join(map(str, v)) for v in (xyz, rpy, axis)]
        more = f'<origin xyz="{texts[0]}" rpy="{texts[1]}"/><axis xyz="{texts[2]}"/>'
        joints.append(joint_xml(f"j{i}", type_, links[parent % len(links)], f"l{i}", more))
        links.append(f"l{i}")
    random.shuffle(joints)  # a URDF may have them in any order
    text = urdf_of(joints, links)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "r.urdf"
        path.write_text(text)
        found = skeleton("arm", path, [f"arm.joint_{i}.position" for i in range(1, 9)])
    by_name = {joint["name"]: joint for joint in found["joints"]}
    moving = {f"j{i}": q for i, (type_, *_, q) in enumerate(tree) if type_ != "fixed"}
    positions = {by_name[name]["channel"]: q for name, q in moving.items()}
    assert len(positions) == len(moving) and None not in positions
    agree(placed(found, positions), true_frames(text, moving), list(by_name))
    assert json.loads(json.dumps(found, allow_nan=False)) == found


def write(folder: Path, joints: list[str], links: list[str], name: str = "r.urdf") -> Path:
    path = folder / name
    path.write_text(urdf_of(joints, links))
    return path


def chain(folder: Path, *types: str) -> Path:
    joints = [joint_xml(f"j{i}", t, f"l{i}", f"l{i + 1}", '<axis xyz="0 0 2"/>') for i, t in enumerate(types)]
    return write(folder, joints, [f"l{i}" for i in range(len(types) + 1)])


def bound(found: dict[str, Any]) -> list[tuple[str, str | None]]:
    return [(joint["name"], joint["channel"]) for joint in found["joints"]]


# channels -------------------------------------------------------------------------------------------


def test_moving_joints_are_counted_from_the_base(tmp_path):
    path = chain(tmp_path, "fixed", "revolute", "fixed", "prismatic", "continuous", "floating")
    found = skeleton("left", path, ["left.joint_1.position", "left.joint_3.position", "arm.joint_2.position"])
    channels = [None, "left.joint_1.position", None, None, "left.joint_3.position", None]
    assert bound(found) == [(f"j{i}", channel) for i, channel in enumerate(channels)]
    kinds = ["fixed", "revolute", "fixed", "prismatic", "revolute", "fixed"]
    assert [joint["type"] for joint in found["joints"]] == kinds
    assert [joint["parent"] for joint in found["joints"]] == [-1, 0, 1, 2, 3, 4]
    assert found["joints"][1]["axis"] == [0.0, 0.0, 1.0], "of length 1"


@pytest.mark.parametrize("name", ["robot.yaml", "robot.json", "folder"])
def test_the_order_of_the_description_wins(tmp_path, name):
    chain(tmp_path, "revolute", "revolute", "prismatic")
    described = {"robot": "r", "urdf": "r.urdf", "joints": [{"name": "j2", "rated_torque": 3}, {"name": "j0"}], "x": 1}
    file = tmp_path / ("robot.yaml" if name == "folder" else name)
    file.write_text(json.dumps(described))
    found = skeleton("arm", tmp_path if name == "folder" else file, SIX)
    assert bound(found) == [("j0", "arm.joint_2.position"), ("j1", None), ("j2", "arm.joint_1.position")]


def test_a_joint_that_follows_has_the_channel_of_the_other(tmp_path):
    follow = '<axis xyz="1 0 0"/><mimic joint="j0" multiplier="-2" offset="0.5"/>'
    joints = [
        joint_xml("j0", "revolute", "a", "b", '<axis xyz="1 0 0"/>'),
        joint_xml("f", "revolute", "b", "c", follow + '<origin xyz="0 0 1"/>'),
        joint_xml("j1", "revolute", "c", "d", '<axis xyz="0 1 0"/>'),
    ]
    path = write(tmp_path, joints, ["a", "b", "c", "d"])
    found = skeleton("arm", path, SIX)
    assert bound(found) == [("j0", SIX[0]), ("f", SIX[0]), ("j1", SIX[1])]
    stands = placed(found, {SIX[0]: 0.3, SIX[1]: 0.7})
    agree(stands, true_frames(path.read_text(), {"j0": 0.3, "f": -0.1, "j1": 0.7}), ["j0", "f", "j1"])


# what cannot be used --------------------------------------------------------------------------------

LAUGHS = "".join(f'<!ENTITY a{i} "{f"&a{i - 1};" * 10}">' for i in range(1, 10))
J = joint_xml("j", "revolute", "a", "b")


def one(type_: str, more: str) -> str:
    return f"<robot>{joint_xml('j', type_, 'a', 'b', more)}</robot>"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (f"<!DOCTYPE r [<!ENTITY a0 'ha'>{LAUGHS}]><robot>&a9;{J}</robot>", "DOCTYPE"),
        ("<!DOCTYPE r SYSTEM 'file:///etc/passwd'><robot/>", "DOCTYPE"),
        (f"<robot>{J}{joint_xml('k', 'revolute', 'c', 'b')}</robot>", "not one tree"),
        (f"<robot>{J}{joint_xml('k', 'revolute', 'c', 'd')}</robot>", "2 links have no parent"),
        (f"<robot>{J}{joint_xml('k', 'fixed', 'x', 'y')}{joint_xml('m', 'fixed', 'y', 'x')}</robot>", "not one tree"),
        ("<robot><joint name='j' type='revolute'/></robot>", "lacks its type"),
        (one("fixed", '<origin xyz="1 2"/>'), "not three numbers"),
        (one("fixed", '<origin xyz="1 2 ${x}"/>'), "xacro"),
        (one("revolute", '<axis xyz="0 0 0"/>'), "no direction"),
        (one("revolute", '<mimic joint="k"/>'), "follows 'k'"),
        ("<robot>" + "".join(joint_xml(f"j{i}", "fixed", f"{i}", f"{i + 1}") for i in range(501)) + "</robot>", "501"),
    ],
)
def test_a_urdf_that_cannot_be_used_is_refused_in_one_line(tmp_path, text, why):
    path = tmp_path / "bad.urdf"
    path.write_text(text)
    with pytest.raises(ConfigError) as refused:
        skeleton("arm", path, SIX)
    told = str(refused.value)
    assert why in told and told.startswith(f"{path}: ") and "\n" not in told


def test_what_is_not_there_is_told(tmp_path):
    with pytest.raises(ConfigError, match="No such file"):
        skeleton("arm", tmp_path / "r.urdf", SIX)
    with pytest.raises(ConfigError, match=r"robot\.yaml"):
        skeleton("arm", tmp_path, SIX)
    (tmp_path / "robot.yaml").write_text("urdf: r.urdf\njoints: [{name: j0}, {name: j1}, {name: elbow}]\n")
    with pytest.raises(ConfigError, match=r"r\.urdf.*No such file"):
        skeleton("arm", tmp_path, SIX)
    chain(tmp_path, "revolute", "fixed")
    with pytest.raises(ConfigError, match="no moving joint j1, elbow; there are j0"):
        skeleton("arm", tmp_path, SIX)
