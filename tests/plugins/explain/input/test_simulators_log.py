"""A log with MuJoCo's own names, and the simulator's file alone."""

import re

import numpy as np
import pyarrow.parquet as pq
import pytest

from cellwatt.errors import ConfigError, RecordingError
from cellwatt.tables import write_table
from cellwatt_plugins.explain.api import arm_of
from tests.plugins.explain.input.reading import examine, read_runs
from tests.plugins.explain.logs import numbered
from tests.plugins.explain.simulators.arms import TwoLinks

pytest.importorskip("mujoco")

LINKS = TwoLinks(friction=(2.0, 1.0), damping=(0.4, 0.2), armature=(0.1, 0.05))
GRIPPER = """
<body name="finger" pos="0 0 -0.3"><joint name="grip" type="slide" axis="1 0 0"/>
<geom type="box" size="0.01 0.01 0.02" mass="0.05"/></body>"""


def motion():
    time = np.arange(0, 12, 0.01)
    w, p = np.array([1.3, 2.1]), np.array([0.0, 1.0])
    angle = np.outer(time, w) + p
    return time, 0.8 * np.sin(angle), 0.8 * w * np.cos(angle), -0.8 * w**2 * np.sin(angle)


def logged(folder, actuators, controls, hand=GRIPPER, name="ctrl"):
    """The file of the arm and a log of it, as a user of MuJoCo writes them."""
    before, _, after = LINKS.mjcf(hand=hand).partition("<actuator>")
    text = before + f"<actuator>{actuators}</actuator>" + after.partition("</actuator>")[2]
    (folder / "arm.xml").write_text(text)
    time, q, qd, _ = motion()
    columns = {"time": time, **numbered("qpos", q, 0), **numbered("qvel", qd, 0), **numbered(name, controls, 0)}
    write_table(folder / "log.parquet", {re.sub(r"_(?=\d)", "", name): values for name, values in columns.items()})
    return folder / "arm.xml", folder / "log.parquet"


@pytest.mark.parametrize("name", ["ctrl", "actuator_force"])
def test_controls_and_forces_are_torques_by_the_gears_of_their_actuators(tmp_path, name):
    torque = LINKS.torque(*motion()[1:])
    motors = '<position joint="grip" kp="9"/><motor joint="elbow" gear="0.5"/><motor joint="shoulder" gear="3"/>'
    values = np.column_stack([torque[:, 0], torque[:, 1] / 0.5, torque[:, 0] / 3])
    simulator, log = logged(tmp_path, motors, values, name=name)
    arm = arm_of(None, simulator, [log])
    assert [joint.name for joint in arm.description.joints] == ["shoulder", "elbow"]
    (run,) = read_runs([log], [simulator], arm.description)
    np.testing.assert_allclose(run.torque, torque)
    assert run.command is None
    notes = examine([run], arm)[1]
    assert "arm.xml: held at their reference: grip" in notes
    assert not any("differs from the simulation" in note for note in notes)


def test_controls_of_some_of_several_actuators_are_refused(tmp_path):
    motors = "".join(f'<motor joint="{n}"/>' for n in ("shoulder", "elbow", "grip"))
    simulator, log = logged(tmp_path, motors, motion()[1][:, :1])
    with pytest.raises(RecordingError, match="1 columns ctrl_0, …, but the robot has 2 joints and 3 actuators"):
        read_runs([log], [simulator], arm_of(None, simulator, [log]).description)


def test_a_log_of_all_joints_holds_those_of_a_gripper_behind_the_arm(tmp_path):
    torque = LINKS.torque(*motion()[1:])
    motors = "".join(f'<motor joint="{n}"/>' for n in ("shoulder", "elbow", "grip"))
    hand = GRIPPER + GRIPPER.replace("finger", "thumb").replace("grip", "pinch")
    simulator, log = logged(tmp_path, motors, np.column_stack([torque, torque[:, 0]]), hand)
    table = pq.read_table(log)
    for name in ("qpos2", "qpos3", "qvel2", "qvel3"):
        table = table.append_column(name, [np.full(len(table), 0.02)])
    pq.write_table(table, log)
    arm = arm_of(None, simulator, [log])
    assert [joint.name for joint in arm.description.joints] == ["shoulder", "elbow"]
    (run,) = read_runs([log], [simulator], arm.description)
    np.testing.assert_allclose(run.position, motion()[1])
    np.testing.assert_allclose(run.torque, torque)


def test_controls_of_servos_are_commands_and_their_law_is_the_torque(tmp_path):
    _, q, qd, _ = motion()
    servos = '<position joint="shoulder" kp="200"/><position joint="elbow" kp="80"/>'
    simulator, log = logged(tmp_path, servos, q + 0.01)
    (run,) = read_runs([log], [simulator], arm_of(None, simulator, [log]).description)
    np.testing.assert_allclose(run.command, q + 0.01)
    # A command is held over a row of 10 ms, so it is half of that late.
    law = np.array([200, 80]) * (0.01 - 0.005 * qd)
    np.testing.assert_allclose(run.torque[5:-5], law[5:-5], atol=0.05)


@pytest.mark.parametrize("servo", [False, True])
def test_controls_without_their_simulator_are_torques_unless_positions_follow_them(tmp_path, servo):
    _, q, qd, qdd = motion()
    torque = LINKS.torque(q, qd, qdd)
    simulator, log = logged(tmp_path, "", q + 0.01 if servo else torque)
    (run,) = read_runs([log], [], arm_of(None, simulator, [log]).description)
    assert (run.command is not None) == servo
    np.testing.assert_allclose(run.torque, np.nan if servo else torque)


def test_something_describes_the_arm(tmp_path):
    with pytest.raises(ConfigError, match=r"give --robot robot\.yaml, or a simulator's file"):
        arm_of(None, None, [tmp_path / "log.parquet"])
