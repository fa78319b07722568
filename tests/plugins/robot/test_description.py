import pytest
import yaml

from cellwatt.errors import ConfigError
from cellwatt_plugins.robot import load_robot

JOINTS = [
    {
        "name": "a",
        "gear_ratio": 101.0,
        "torque_constant": 12.5,
        "rotor_inertia": 2.4,
        "coulomb_friction": 9.0,
        "viscous_friction": 14.0,
        "winding_resistance": 0.6,
    },
    {"name": "b"},
]
WHOLE = {"robot": "bench", "urdf": "bench.urdf", "sample_rate": 125, "joints": JOINTS, "standby_power": 81.0}


def write(folder, content):
    (folder / "robot.yaml").write_text(content if isinstance(content, str) else yaml.safe_dump(content))
    return folder / "robot.yaml"


def test_a_description_with_what_it_leaves_out(tmp_path):
    robot = load_robot(write(tmp_path, WHOLE))
    assert robot.robot == "bench"
    assert robot.urdf == tmp_path / "bench.urdf"
    assert robot.sample_rate == 125.0
    assert robot.standby_power == 81.0
    first, second = robot.joints
    assert (first.name, first.gear_ratio, first.torque_constant, first.winding_resistance) == ("a", 101.0, 12.5, 0.6)
    assert (second.gear_ratio, second.torque_constant, second.coulomb_friction) == (1.0, 0.0, 0.0)
    assert second.velocity_limit is None
    assert robot.tolerances.friction == 0.06


def test_a_folder_stands_for_its_description(tmp_path):
    write(tmp_path, WHOLE)
    assert load_robot(tmp_path) == load_robot(tmp_path / "robot.yaml")


def test_an_absolute_urdf_stays(tmp_path):
    elsewhere = tmp_path / "models" / "arm.urdf"
    assert load_robot(write(tmp_path, {**WHOLE, "urdf": str(elsewhere)})).urdf == elsewhere


def test_keys_for_others_are_let_be(tmp_path):
    joints = [{**JOINTS[0], "colour": "red"}]
    assert load_robot(write(tmp_path, {**WHOLE, "joints": joints, "serial": 7})).joints[0].name == "a"


def rod(**changes):
    return {"link": 1, "from": [0, 0, 0], "to": [0, 0, 1], "radius": 0.1, **changes}


def joint(**changes):
    return {**WHOLE, "joints": [{**JOINTS[0], **changes}]}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "expected the keys robot, urdf and joints"),
        ("- a\n- b\n", "expected the keys robot, urdf and joints"),
        ("robot: [\n", "cannot be read"),
        ({key: value for key, value in WHOLE.items() if key != "urdf"}, "urdf: Field required"),
        ({**WHOLE, "joints": []}, "joints: Tuple should have at least 1 item"),
        ({**WHOLE, "joints": [JOINTS[1], JOINTS[1]]}, "two joints have the same name"),
        ({**WHOLE, "sample_rate": 0}, "sample_rate: Input should be greater than 0 (found 0)"),
        ({**WHOLE, "standby_power": -1.0}, "standby_power: Input should be greater than or equal to 0 (found -1.0)"),
        ({**WHOLE, "tolerances": {"fricton": 0.1}}, "tolerances.fricton: Extra inputs are not permitted"),
        ({**WHOLE, "payload": -1}, "payload: Input should be greater than or equal to 0 (found -1)"),
        ({**WHOLE, "torque_from": "motor"}, "torque_from: Input should be 'current' or 'sensor'"),
        ({**WHOLE, "capsules": [rod(link=4)]}, "capsules: Value error, a link above 2, the last"),
        ({**WHOLE, "capsules": [rod(radius=-1)]}, "capsules.0.radius: Input should be greater than 0 (found -1)"),
        (joint(name=None), "joints.0.name: Input should be a valid string"),
        (joint(coulomb_friction="much"), "joints.0.coulomb_friction: Input should be a valid number"),
        (joint(coulomb_friction=float("nan")), "joints.0.coulomb_friction: Input should be"),
        (joint(rotor_inertia=float("inf")), "joints.0.rotor_inertia: Input should be a finite number (found inf)"),
        (joint(gear_ratio=0), "joints.0.gear_ratio: Input should be greater than 0 (found 0)"),
        (joint(velocity_limit=-1), "joints.0.velocity_limit: Input should be greater than 0 (found -1)"),
    ],
)
def test_a_mistake_is_one_line_with_its_place(tmp_path, content, message):
    path = write(tmp_path, content)
    with pytest.raises(ConfigError) as caught:
        load_robot(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_description_that_cannot_be_read(tmp_path):
    with pytest.raises(ConfigError, match=r"robot\.yaml: cannot be read: .*No such file"):
        load_robot(tmp_path)
    (tmp_path / "robot.yaml").write_bytes(b"\xff\xfe\x00robot")
    with pytest.raises(ConfigError, match=r"robot\.yaml: cannot be read"):
        load_robot(tmp_path)


NESTED = "a: &a [x,x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{b}: &{b} [{','.join([f'*{a}'] * 10)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize("text", ["robot: 2001-13-01", "a: !!bool 5", "[" * 50_000, NESTED, NESTED + "joints: *i"])
def test_what_no_reader_of_yaml_should_meet_is_told_in_a_line(tmp_path, text):
    with pytest.raises(ConfigError, match=r"robot\.yaml") as error:
        load_robot(write(tmp_path, text))
    assert len(str(error.value)) < 500
