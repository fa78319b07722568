import re
import sys

import numpy as np
import pytest

from cellwatt.errors import ConfigError
from cellwatt_plugins.explain.simulators import load_simulator
from cellwatt_plugins.robot.simulated import described
from tests.plugins.explain.simulators.arms import FULL, TwoLinks, moves

pytest.importorskip("mujoco")

JOINTS = ("shoulder", "elbow")
FINGER = """
          <body name="finger" pos="0 0 -0.3">
            <joint name="grip" type="slide" axis="1 0 0" frictionloss="3"/>
            <inertial pos="0 0 0" mass="1e-9" diaginertia="1e-12 1e-12 1e-12"/>
          </body>"""


def written(folder, text, name="arm.xml"):
    (folder / name).write_text(text)
    return folder / name


def test_torque_is_that_of_the_equations_of_motion(tmp_path):
    """Friction loss, damping, armature, a spring and two links, all in one file."""
    arm = load_simulator(written(tmp_path, FULL.mjcf()), JOINTS)
    np.testing.assert_allclose(arm.torque(*moves(), leading=False), FULL.torque(*moves()), atol=1e-9)
    assert arm.notes == ()


def test_a_urdf_needs_no_meshes(tmp_path):
    links = TwoLinks(friction=(2.0, 1.0), damping=(1.5, 0.4))
    mesh = '<visual><geometry><mesh filename="package://nowhere/upper.dae"/></geometry></visual>'
    text = f'\n<?xml version="1.0" encoding="ISO-8859-1"?><!-- Gerät -->{links.urdf(shape=mesh)}'
    (tmp_path / "arm.urdf").write_text(text, encoding="latin-1")
    arm = load_simulator(tmp_path / "arm.urdf", JOINTS)
    np.testing.assert_allclose(arm.torque(*moves(), leading=False), links.torque(*moves()), atol=1e-9)


def test_links_of_a_urdf_may_be_points(tmp_path):
    text = re.sub(r'(i[xyz]{2})="[^"]*"', r'\1="0"', TwoLinks().urdf())
    torque = load_simulator(written(tmp_path, text, "arm.urdf"), JOINTS).torque(*moves())
    assert 0.1 < np.max(np.abs(torque - TwoLinks().torque(*moves()))) < np.max(np.abs(torque))


@pytest.mark.parametrize("off", ['<option gravity="0 0 0"/>', '<option><flag gravity="disable"/></option>'])
def test_gravity_that_is_switched_off_is_said(tmp_path, off):
    path = written(tmp_path, re.sub("<option[^>]*/>", "", FULL.mjcf()).replace("<worldbody>", f"{off}<worldbody>"))
    arm = load_simulator(path, JOINTS)
    assert arm.notes == ("arm.xml: its gravity is switched off: its torques are without weight",)
    assert described(path).gravity == (0, 0, 0)


def test_fingers_rest_and_contacts_do_not_push(tmp_path):
    """The elbow folds the lower link into the upper one, and a gripper has a joint of its own, drawn by a cable."""
    cable = '<tendon><fixed frictionloss="2"><joint joint="grip" coef="1"/></fixed></tendon>'
    text = FULL.mjcf(hand=FINGER).replace("</worldbody>", f"</worldbody>{cable}")
    arm = load_simulator(written(tmp_path, text), JOINTS)
    np.testing.assert_allclose(arm.torque(*moves(), leading=False), FULL.torque(*moves()), atol=1e-6)
    left_out = "arm.xml: its frictions of tendons are left out"
    assert arm.notes == ("arm.xml: held at their reference: grip", left_out)


@pytest.mark.parametrize(
    ("text", "names", "said"),
    [
        ("<mujoco><worldbody>", JOINTS, "MuJoCo cannot read it"),
        (FULL.mjcf(), ("shoulder", "wrist"), "no joint wrist; its hinges and slides are shoulder, elbow"),
        (FULL.mjcf().replace(' name="shoulder"', "").replace("shoulder", "elbow"), ("i", "ii"), "one without name"),
        (FULL.mjcf(), ("elbow", "shoulder"), "in the order of robot.yaml"),
        (FULL.mjcf(base='<freejoint name="root"/><geom size=".1"/>'), JOINTS, "joint root leaves the base free"),
    ],
)  # fmt: skip
def test_what_is_no_such_arm_is_refused_in_one_line(tmp_path, text, names, said):
    with pytest.raises(ConfigError, match=said) as refused:
        load_simulator(written(tmp_path, text), names)
    assert "\n" not in str(refused.value)
    assert str(refused.value).startswith(str(tmp_path / "arm.xml"))


def test_a_missing_extra_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ConfigError, match=r'pip install "cellwatt\[simulators\]"'):
        load_simulator(written(tmp_path, FULL.mjcf()), JOINTS)


def test_units_of_a_slide(tmp_path):
    text = TwoLinks().mjcf().replace('name="elbow"', 'name="elbow" type="slide"')
    simulator = load_simulator(written(tmp_path, text), JOINTS)
    assert [simulator.unit(i, "N*m*s/rad") for i in range(2)] == ["N*m*s/rad", "N*s/m"]
