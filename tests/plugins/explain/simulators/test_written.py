"""What is found, written into files of a two-link arm, whose torque is known in closed form."""

import re
from dataclasses import replace

import numpy as np
import pytest

from cellwatt.errors import ConfigError
from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.explain.model import FittedTerm, Retuned
from cellwatt_plugins.explain.simulators import load_simulator
from cellwatt_plugins.explain.simulators.correction import correction
from cellwatt_plugins.explain.simulators.files import Files
from cellwatt_plugins.explain.simulators.mend import verify
from cellwatt_plugins.explain.simulators.placing import placing
from cellwatt_plugins.explain.simulators.target import target
from cellwatt_plugins.explain.simulators.write_mjcf import write_mjcf
from cellwatt_plugins.explain.simulators.write_urdf import what_urdf_holds, write_urdf
from cellwatt_plugins.robot import Arm, Body, Joint, RobotDescription
from cellwatt_plugins.robot.effects import BY_NAME
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import exact
from cellwatt_plugins.robot.servo.law import servo_of
from tests.plugins.explain.simulators.arms import FULL, TwoLinks, moves

mujoco = pytest.importorskip("mujoco")

JOINTS = ("shoulder", "elbow")
PLAIN = TwoLinks(friction=(2.0, 1.0), damping=(1.5, 0.4))


def found(name, joint, *coefficients, shape=()):
    return FittedTerm(Term(BY_NAME[name], joint, shape), np.array(coefficients))


def point(mass, below):
    """Inertial parameters of a point mass on a link, ``below`` m from its joint."""
    return np.array([mass, 0, 0, -mass * below, *(mass * below**2 * np.array([1.0, 0, 1, 0, 0, 0]))])


class Cell:
    """A user's file beside the URDF that robot.yaml names."""

    def __init__(self, folder, text, suffix=".xml"):
        self.folder = folder
        (folder / "robot.urdf").write_text(PLAIN.urdf())
        self.path = folder / f"arm{suffix}"
        self.path.write_text(text)
        joints = tuple(Joint(name=name) for name in JOINTS)
        self.arm = Arm.of(RobotDescription(robot="planar", urdf=folder / "robot.urdf", joints=joints))

    @property
    def states(self):
        return States("run", 0, np.arange(200) * 0.01, exact(*moves()), self.arm)

    def goal(self, *terms, retuned=None):
        simulator = load_simulator(self.path, JOINTS)
        back = correction(retuned or Retuned.nothing(2), terms, [self.states])
        return simulator, target(placing(simulator, self.arm.body), back, [self.states], np.ones(2))

    def mended(self, *terms, retuned=None, out="out"):
        simulator, goal = self.goal(*terms, retuned=retuned)
        if self.path.suffix == ".urdf":
            return write_urdf(simulator, what_urdf_holds(simulator, goal), self.folder / out)
        return write_mjcf(simulator, goal, self.folder / out)


def same(written, arm, atol=1e-8):
    torque = load_simulator(written.path, JOINTS).torque(*moves(), leading=False)
    np.testing.assert_allclose(torque, arm.torque(*moves()), atol=atol)


CASES = [
    ([found("coulomb_friction", 1, 1.5)], {"friction": (2.0, 2.5)}),
    ([found("viscous_friction", 0, 0.7)], {"damping": (2.2, 0.4)}),
    ([found("rotor_inertia", 1, 0.2)], {"armature": (0.3, 0.3)}),
    ([found("spring_load", 1, 6.0, -3.0)], {"stiffness": (8.0, 6.0), "rest": (0.4, 0.5)}),
]


@pytest.mark.parametrize(("terms", "changes"), CASES)
def test_an_mjcf_has_what_was_found(tmp_path, terms, changes):
    cell = Cell(tmp_path, FULL.mjcf())
    same(cell.mended(*terms), replace(FULL, **changes))
    assert cell.path.read_text() == FULL.mjcf()


def test_degrees_and_default_classes_are_the_users(tmp_path):
    text = FULL.mjcf().replace('angle="radian"', 'angle="degree"').replace(' springref="0.4"', ' springref="22.9183"')
    text = text.replace(' frictionloss="1.0"', "").replace(
        "<worldbody>", '<default><joint frictionloss="1"/></default>\n<worldbody>'
    )
    written = Cell(tmp_path, text).mended(*CASES[3][0], *CASES[0][0])
    same(written, replace(FULL, **CASES[3][1], **CASES[0][1]), atol=1e-4)
    assert '<default><joint frictionloss="1"/></default>' in written.path.read_text()


def test_a_payload_is_a_body_and_gravity_leans(tmp_path):
    """Bodies' frames in the file are not the joints': a point mass on the elbow's link, 0.3 m below the joint."""
    arm = TwoLinks()
    loaded = Cell(tmp_path, arm.mjcf()).mended(found("payload", None, *point(1.2, 0.3)))
    total, centre = 2.7, (1.5 * 0.15 + 1.2 * 0.3) / 2.7
    about = 0.02 + 1.5 * (centre - 0.15) ** 2 + 1.2 * (0.3 - centre) ** 2
    # MuJoCo wants some extent of every body: the nearest has 1 mm.
    same(loaded, replace(arm, mass=(3.0, total), centre=(0.2, centre), inertia=(0.05, about)), atol=2e-3)
    assert '<body name="payload"><inertial' in loaded.path.read_text()


def test_a_link_that_is_off_and_retuned_numbers(tmp_path):
    retuned = replace(Retuned.nothing(2), coulomb_friction=np.array([-0.3, 0.1]), viscous_friction=np.array([0.2, 0.0]))
    heavier = found("link_inertial_error", 1, 0.5, 0, 0, -0.5 * 0.15, *(0.5 * 0.15**2 * np.array([1.0, 0, 1, 0, 0, 0])))
    written = Cell(tmp_path, FULL.mjcf()).mended(heavier, retuned=retuned)
    same(written, replace(FULL, mass=(3.0, 2.0), friction=(1.7, 1.1), damping=(1.7, 0.4)))


def test_a_gain_goes_into_the_gear(tmp_path):
    written = Cell(tmp_path, FULL.mjcf()).mended(found("torque_gain", 1, 0.25))
    assert '<motor name="m2" joint="elbow" gear="40"/>' in written.path.read_text()
    same(written, FULL)


def test_a_limit_is_written_where_the_drive_had_none(tmp_path):
    servos = re.sub(r'<motor name="m\d" joint="(\w+)" gear="50"/>', r'<position joint="\1" kp="9"/>', FULL.mjcf())
    cell = Cell(tmp_path, servos)
    simulator, goal = cell.goal()
    limited = replace(servo_of(cell.path, JOINTS), low=np.array([-47, -np.inf]), high=np.array([47, np.inf]))
    written = write_mjcf(simulator, replace(goal, servo=limited), tmp_path / "out")
    drive = '<position joint="shoulder" kp="9" kv="0" forcelimited="true" forcerange="-47 47"/>'
    assert drive in written.path.read_text()
    assert [(change.what, change.value, change.was) for change in written.applied] == [("forcerange", 47.0, None)]


def test_friction_with_powers_of_the_speed(tmp_path):
    """2 Nm w³ is one of the terms that MuJoCo's damping has."""
    cell = Cell(tmp_path, FULL.mjcf())
    torque = load_simulator(cell.mended(found("nonlinear_viscous_friction", 0, 2.0, shape=(3.0,))).path, JOINTS).torque
    more = np.column_stack([2.0 * moves()[1][:, 0] ** 3, np.zeros(200)])
    np.testing.assert_allclose(torque(*moves(), leading=False), FULL.torque(*moves()) + more, atol=1e-6)


FOUND_AT_THE_ELBOWS_MOTOR = [
    found("coulomb_friction", 1, 1.5), found("viscous_friction", 1, 0.3), found("rotor_inertia", 1, 0.2)
]  # fmt: skip


def test_a_motor_that_turns_with_two_joints_is_a_tendon(tmp_path):
    cell = Cell(tmp_path, PLAIN.mjcf())
    cell.arm = cell.arm.with_coupling(np.array([[1.0, 0.0], [1.0, 1.0]]))
    written = cell.mended(*FOUND_AT_THE_ELBOWS_MOTOR)
    speed, gain = moves()[1].sum(axis=1), moves()[2].sum(axis=1)
    motor = 2.5 * np.tanh(speed / 0.004) + 0.7 * speed + 0.2 * gain
    alone = replace(PLAIN, friction=(2.0, 0.0), damping=(1.5, 0.0)).torque(*moves())
    torque = load_simulator(written.path, JOINTS).torque(*moves(), leading=False)
    np.testing.assert_allclose(torque, alone + motor[:, None], atol=1e-8)
    assert {(each.what, each.value) for each in written.applied if each.where == "tendon motor_of_elbow"} == {
        ("frictionloss", 2.5), ("damping", 0.7), ("armature", 0.2)
    }  # fmt: skip


def test_a_mended_file_can_be_mended_again(tmp_path):
    """Its elbow's motor is a tendon already: what is found since is another one."""
    cell = Cell(tmp_path, PLAIN.mjcf())
    cell.arm = cell.arm.with_coupling(np.array([[1.0, 0.0], [1.0, 1.0]]))
    cell.path = cell.mended(*FOUND_AT_THE_ELBOWS_MOTOR).path
    once = load_simulator(cell.path, JOINTS)
    written = cell.mended(found("coulomb_friction", 1, 0.5), out="again")
    assert once.notes == ()
    more = 0.5 * np.tanh(moves()[1].sum(axis=1) / 0.004)
    twice = load_simulator(written.path, JOINTS).torque(*moves(), leading=False)
    np.testing.assert_allclose(twice, once.torque(*moves(), leading=False) + more[:, None], atol=1e-8)


def test_a_urdf_holds_no_motor_that_turns_with_two_joints(tmp_path):
    cell = Cell(tmp_path, PLAIN.urdf(), ".urdf")
    cell.arm = cell.arm.with_coupling(np.array([[1.0, 0.0], [1.0, 1.0]]))
    simulator, goal = cell.goal(*FOUND_AT_THE_ELBOWS_MOTOR)
    held = what_urdf_holds(simulator, goal)
    assert [each[:2] for each in held.refused] == [
        ("coulomb_friction", 1), ("viscous_friction", 1), ("rotor_inertia", 1)
    ]  # fmt: skip
    same(write_urdf(simulator, held, tmp_path / "out"), PLAIN)


def test_inertias_of_no_body_are_the_nearest_that_exists(tmp_path):
    """More mass taken away than the link has: the rest of it must still be a body, and it is said."""
    simulator, goal = Cell(tmp_path, FULL.mjcf()).goal(found("link_inertial_error", 1, -2.0, *(9 * [0.0])))
    assert goal.links[1, 0] > 0
    assert "nearest possible ones" in goal.notes[0]
    write_mjcf(simulator, goal, tmp_path / "out")
    load_simulator(tmp_path / "out" / "arm.mended.xml", JOINTS)


def test_a_urdf_has_friction_damping_links_and_a_payload(tmp_path):
    written = Cell(tmp_path, PLAIN.urdf(), ".urdf").mended(
        found("coulomb_friction", 1, 1.5), found("viscous_friction", 0, 0.7),
        found("link_inertial_error", 0, 0.5, *(9 * [0.0])), found("rotor_inertia", 1, 0.2),
    )  # fmt: skip
    # Mass alone, at the joint's own origin: gravity does not feel it.
    same(written, replace(PLAIN, friction=(2.0, 2.5), damping=(2.2, 0.4)))
    simulator, goal = Cell(tmp_path, PLAIN.urdf(), ".urdf").goal(found("rotor_inertia", 1, 0.2))
    assert what_urdf_holds(simulator, goal).refused == (("rotor_inertia", 1, "a URDF has no such term"),)


def write_rock(folder):
    folder.mkdir()
    corners = "v 0 0 0\nv .1 0 0\nv 0 .1 0\nv 0 0 .1\n"
    (folder / "rock.obj").write_text(corners + "f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")


def test_the_mesh_folder_of_a_urdf_is_found_from_the_new_folder(tmp_path):
    write_rock(tmp_path / "shapes")
    (tmp_path / "arm.urdf").write_text(
        '<robot name="r"><mujoco><compiler meshdir="shapes"/></mujoco><link name="b"><collision><geometry>'
        '<mesh filename="rock.obj"/></geometry></collision></link></robot>'
    )
    (written,) = Files(tmp_path / "arm.urdf").write(tmp_path / "far")
    assert mujoco.MjModel.from_xml_path(str(written)).nmesh == 1


def test_included_files_and_meshes_are_found_from_the_new_folder(tmp_path):
    """A scene that includes the arm, whose mesh lies in a folder of its own: both are read from elsewhere."""
    write_rock(tmp_path / "shapes")
    arm = FULL.mjcf().replace('autolimits="true"', 'autolimits="true" meshdir="shapes"')
    (tmp_path / "only_arm.xml").write_text(arm)
    scene = (
        '<mujoco>\n  <include file="only_arm.xml"/>\n  <asset><mesh name="rock" file="rock.obj"/>'
        '<model name="grip" file="grip.xml"/></asset>\n</mujoco>\n'
    )
    (tmp_path / "grip.xml").write_text(
        '<mujoco><worldbody><body name="g"><geom size=".01"/></body></worldbody></mujoco>'
    )
    written = Cell(tmp_path, scene).mended(*CASES[0][0], out="far/away")
    same(written, replace(FULL, **CASES[0][1]))
    assert written.path == tmp_path / "far" / "away" / "arm.mended.xml"
    assert (tmp_path / "only_arm.xml").read_text() == arm
    assert 'meshdir="../../shapes"' in (tmp_path / "far" / "away" / "only_arm.mended.xml").read_text()


def test_nothing_is_left_of_files_whose_torques_are_not_the_intended_ones(tmp_path):
    (tmp_path / "only_arm.xml").write_text(FULL.mjcf())
    cell = Cell(tmp_path, '<mujoco>\n  <include file="only_arm.xml"/>\n</mujoco>\n')
    simulator, goal = cell.goal(*CASES[0][0])
    written = write_mjcf(simulator, goal, tmp_path / "out")
    user, floor = placing(simulator, cell.arm.body), np.ones(2)
    verify(user, goal, cell.states, floor, written)
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"arm.mended.xml", "only_arm.mended.xml"}
    with pytest.raises(ConfigError, match=r"cannot be mended: joint elbow would be off by 0\.99"):
        verify(user, replace(goal, friction=goal.friction + np.array([0.0, 1.0])), cell.states, floor, written)
    assert list((tmp_path / "out").iterdir()) == []


def test_included_files_of_one_name_stay_two_files(tmp_path):
    for arm, step in (("left", "1"), ("right", "2")):
        (tmp_path / arm).mkdir()
        (tmp_path / arm / "arm.xml").write_text(f'<mujoco><option timestep="{step}"/></mujoco>')
    (tmp_path / "arm.xml").write_text('<mujoco><include file="left/arm.xml"/><include file="right/arm.xml"/></mujoco>')
    files = Files(tmp_path / "arm.xml")
    for option in files.all("option"):
        option.set(gravity="0 0 0")
    main, *included = files.write(tmp_path / "out")
    assert main.name == "arm.mended.xml"
    assert [path.read_text().count(f'timestep="{i + 1}"') for i, path in enumerate(included)] == [1, 1]
    assert all(f'file="{path.name}"' in main.read_text() for path in included)


def test_axes_that_lie_a_little_elsewhere_are_said(tmp_path):
    """The elbow is 2 mm nearer in the user's file: still this arm."""
    near = FULL.mjcf().replace('<body name="lower" pos="0 0 -0.5">', '<body name="lower" pos="0 0 -0.498">')
    simulator = load_simulator(Cell(tmp_path, near).path, JOINTS)
    found = placing(simulator, Body(tmp_path / "robot.urdf", JOINTS))
    assert re.fullmatch(r"arm\.xml: its axes differ from the URDF's by up to 0\.\d\d° and [12]\.\d mm", found.notes[0])
    assert 0.005 < found.off < 0.03
