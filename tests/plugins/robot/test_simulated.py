"""Arms that a simulator's file describes alone, against MuJoCo's own inverse dynamics."""

import re

import numpy as np
import pytest

from cellwatt.errors import ConfigError
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.simulated import described
from tests.plugins.robot import scara

mujoco = pytest.importorskip("mujoco")

ARM = """<mujoco model="bench">
  <compiler angle="degree" autolimits="true"/>
  <option gravity="4 -1 -8.5"/>
  <default><joint damping="2" armature="0.3"/></default>
  <worldbody>
    <body name="column" pos="0.1 0 0.4" euler="10 0 30">
      <joint name="yaw" axis="0 0 1" frictionloss="4" range="-170 170"/>
      <geom type="cylinder" size="0.06 0.1" mass="6"/>
      <body name="upper" pos="0 0 0.2" euler="0 20 0">
        <joint name="shoulder" pos="0.02 0 0.01" axis="0 1 0.2" ref="15" armature="0.5"/>
        <geom type="capsule" fromto="0 0 0 0 0 0.4" size="0.05"/>
        <body name="plate" pos="0 0.05 0.2"><geom type="box" size="0.04 0.02 0.03"/></body>
        <body name="quill" pos="0 0 0.45">
          <joint name="lift" type="slide" axis="0 0.6 0.8" range="-0.1 0.2"/>
          <inertial pos="0.03 0 0.05" mass="1.5" fullinertia="0.01 0.012 0.008 0.001 0 0.002"/>
          <body name="finger_left" pos="0 0.03 0.1">
            <joint name="left" type="slide" axis="0 1 0"/><geom type="box" size="0.01 0.01 0.04" mass="0.1"/>
          </body>
          <body name="finger_right" pos="0 -0.03 0.1">
            <joint name="right" type="slide" axis="0 -1 0"/><geom type="box" size="0.01 0.01 0.04" mass="0.1"/>
          </body>
        </body>
      </body>
    </body>
  </worldbody>
</mujoco>"""
NAMES = ("yaw", "shoulder", "lift")


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "bench.xml"
    path.write_text(ARM)
    return path


def needed(path, names, q, qd, qdd):
    """Torques of a MuJoCo file, friction aside, as MuJoCo itself says."""
    model = mujoco.MjModel.from_xml_path(str(path))
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_FRICTIONLOSS
    data, out = mujoco.MjData(model), np.empty_like(q)
    place = [model.joint(name).qposadr[0] for name in names]
    dof = [model.joint(name).dofadr[0] for name in names]
    for i in range(len(q)):
        data.qpos[place], data.qvel[dof], data.qacc[dof] = q[i], qd[i], qdd[i]
        mujoco.mj_inverse(model, data)
        out[i] = data.qfrc_inverse[dof]
    return out + model.dof_frictionloss[dof] * np.tanh(qd / 0.004)


def test_two_joints_of_one_body_are_refused(file):
    file.write_text(ARM.replace('<joint name="lift"', '<joint name="twist" axis="0 0 1"/><joint name="lift"'))
    with pytest.raises(ConfigError, match="two joints move the same body: give each joint a body of its own"):
        Arm.of(described(file, 4))


@pytest.mark.parametrize("turned", ["0 20 0", "30 -90 10"])
def test_a_mujoco_file_is_an_arm(file, turned):
    """Masses of geoms, degrees, an angle at rest that is not 0, axes beside the bodies' frames, gravity, a slide."""
    file.write_text(ARM.replace("0 20 0", turned))
    arm = Arm.of(described(file, 3))
    assert tuple(joint.name for joint in arm.description.joints) == NAMES
    assert [joint.kind for joint in arm.description.joints] == ["revolute", "revolute", "prismatic"]
    assert arm.column("coulomb_friction").tolist() == [4.0, 0.0, 0.0]
    assert arm.column("rotor_inertia").tolist() == [0.3, 0.5, 0.3]
    assert arm.column("viscous_friction").tolist() == [2.0, 2.0, 2.0]
    np.testing.assert_allclose(arm.limits[[0, 2]], [np.radians([-170, 170]), [-0.1, 0.2]])
    random = np.random.default_rng(1)
    q, qd, qdd = (random.uniform(-1, 1, (50, 3)) * size for size in ([2, 1.5, 0.1], [2, 2, 0.5], [4, 4, 2]))
    np.testing.assert_allclose(arm.torque(q, qd, qdd), needed(file, NAMES, q, qd, qdd), rtol=1e-7, atol=1e-7)


def test_a_mujoco_file_stands_for_robot_yaml(file):
    """Both fingers are ends of a row: which of them the arm has is for robot.yaml to say."""
    with pytest.raises(ConfigError, match="several arms have 4 joints"):
        Arm.load(file)
    file.write_text(ARM.replace('<joint name="right" type="slide" axis="0 -1 0"/>', ""))
    assert Arm.load(str(file)).joints == 4
    with pytest.raises(ConfigError, match=r"has no torque_constant: write a robot\.yaml"):
        Arm.load(file, ("torque_constant",))


def test_as_many_joints_as_the_file_has_are_those_of_the_arm_before_its_gripper(file):
    for joints in (5, [f"axis_{i}" for i in range(5)]):
        assert tuple(joint.name for joint in described(file, joints).joints) == NAMES


def test_all_joints_of_two_arms_are_no_arm_and_its_gripper(tmp_path):
    """Of one arm with seven joints and one with six, on a turning torso."""
    path = tmp_path / "two.xml"
    body = '<body pos="0.1 0 0"><joint name="{}" axis="0 1 0"/><geom size="0.05"/>{}</body>'
    arms = [
        "".join(body.split("{}")[0] + f"{side}{i}" + '" axis="0 1 0"/><geom size="0.05"/>' for i in range(count))
        + count * "</body>"
        for side, count in (("left", 7), ("right", 6))
    ]
    for torso, count in (("{}", 13), (body.format("torso", "{}"), 14)):
        path.write_text(f"<mujoco><worldbody>{torso.format(''.join(arms))}</worldbody></mujoco>")
        with pytest.raises(ConfigError, match="leave out the columns of other joints"):
            described(path, count)


def test_more_joints_than_the_file_has(file):
    with pytest.raises(ConfigError, match="chain of joints from the base is yaw, shoulder, lift, left, the recording"):
        described(file, 6)


def test_joints_without_names_are_asked_for_them(file):
    file.write_text(re.sub(r"<joint name=\"\w+\"", "<joint", ARM))
    with pytest.raises(ConfigError, match="no joint with a name moves: give each hinge and slide a name"):
        described(file, 3)


def test_a_urdf_stands_for_robot_yaml(tmp_path):
    fingers = "".join(
        f'<link name="{name}"/><joint name="{name}_joint" type="prismatic"><parent link="link_3"/>'
        f'<child link="{name}"/><limit lower="0" upper="0.04" effort="0" velocity="0"/>{mimic}</joint>'
        for name, mimic in (("finger", ""), ("thumb", '<mimic joint="finger_joint"/>'))
    )
    dynamics = '<dynamics friction="3.5" damping="0.8"/></joint>'
    text = scara.urdf().replace("</joint>", dynamics, 1).replace("</robot>", f"{fingers}</robot>")
    (tmp_path / "arm.urdf").write_text(text)
    arm = Arm.of(described(tmp_path / "arm.urdf", 3))
    assert [joint.name for joint in arm.description.joints] == ["axis_1", "axis_2", "axis_3"]
    assert arm.column("coulomb_friction").tolist() == [3.5, 0.0, 0.0]
    assert arm.column("viscous_friction").tolist() == [0.8, 0.0, 0.0]
    assert Arm.load(tmp_path / "arm.urdf").joints == 4, "the thumb follows the finger"


def test_a_urdf_that_cannot_be_is_told_in_one_line(tmp_path):
    file = tmp_path / "arm.urdf"
    file.write_text(scara.urdf().replace("</joint>", '<dynamics damping="-0.8"/></joint>', 1))
    with pytest.raises(ConfigError, match=r"arm\.urdf: a joint has an impossible value: .*-0\.8"):
        described(file)
    ring = '<joint name="{}" type="fixed"><parent link="{}"/><child link="{}"/></joint>'
    rings = ring.format("to", "one", "other") + ring.format("fro", "other", "one")
    swing = ring.format("swing", "other", "third").replace("fixed", "continuous")
    file.write_text(f'<robot name="r"><link name="one"/><link name="other"/><link name="third"/>{rings}{swing}</robot>')
    with pytest.raises(ConfigError, match=r"arm\.urdf: cannot be read as a URDF"):
        described(file)


def test_gravity_of_an_arm_on_a_wall(tmp_path):
    path = scara.write(tmp_path)
    path.write_text(path.read_text() + "gravity: [9.81, 0, 0]\n")
    arm = Arm.load(path)
    assert arm.gravity(np.zeros((1, 3)))[0, 2] == pytest.approx(0.0, abs=1e-9)
    assert abs(arm.gravity(np.full((1, 3), 0.5))[0, 0]) > 1.0
