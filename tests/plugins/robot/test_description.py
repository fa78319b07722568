import re
from pathlib import Path

import pytest
import yaml

from cellwatt.config.reference import markdown
from cellwatt.errors import ConfigError
from cellwatt_plugins.robot import RobotDescription, load_robot

PAGE = Path(__file__).resolve().parents[3] / "docs" / "robots.md"

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
        ("", "the file is empty; expected robot, urdf, joints"),
        ("- a\n- b\n", "found a list, expected settings (key: value) starting with robot, urdf, joints"),
        ("robot: [\n", "not valid YAML"),
        ({key: value for key, value in WHOLE.items() if key != "urdf"}, "the key 'urdf' is missing"),
        ({**WHOLE, "joints": []}, "joints: found a list, expected at least 1 entries"),
        ({**WHOLE, "joints": [JOINTS[1], JOINTS[1]]}, "two joints have the same name"),
        ({**WHOLE, "sample_rate": 0}, "sample_rate: found 0, expected a value above 0"),
        ({**WHOLE, "standby_power": -1.0}, "standby_power: found -1.0, expected at least 0"),
        (
            {**WHOLE, "tolerances": {"fricton": 0.1}},
            "tolerances.fricton: unknown key 'fricton'; did you mean",
        ),
        ({**WHOLE, "payload": -1}, "payload: found -1, expected at least 0"),
        ({**WHOLE, "torque_from": "motor"}, "torque_from: found 'motor', expected 'current' or 'sensor'"),
        ({**WHOLE, "capsules": [rod(link=4)]}, "capsules: a link above 2, the last"),
        ({**WHOLE, "capsules": [rod(radius=-1)]}, "capsules[0].radius: found -1, expected a value above 0"),
        (joint(name=None), "joints[0].name: found nothing, expected text"),
        (joint(coulomb_friction="much"), "joints[0].coulomb_friction: found 'much', expected a number"),
        (joint(coulomb_friction=float("nan")), "joints[0].coulomb_friction: found .nan, expected a finite number"),
        (joint(rotor_inertia=float("inf")), "joints[0].rotor_inertia: found .inf, expected a finite number"),
        (joint(gear_ratio=0), "joints[0].gear_ratio: found 0, expected a value above 0"),
        (joint(velocity_limits=1), "joints[0].velocity_limits: unknown key 'velocity_limits'; did you mean"),
        (joint(velocity_limit=-1), "joints[0].velocity_limit: found -1, expected a value above 0"),
    ],
)
def test_a_mistake_is_one_line_with_its_place(tmp_path, content, message):
    path = write(tmp_path, content)
    with pytest.raises(ConfigError) as caught:
        load_robot(path)
    assert re.match(rf"{re.escape(str(path))}:\d+:\d+: ", str(caught.value))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_description_that_cannot_be_read(tmp_path):
    with pytest.raises(ConfigError, match=r"robot\.yaml: cannot be read: no such file"):
        load_robot(tmp_path)
    (tmp_path / "robot.yaml").write_bytes(b"\xff\xfe\x00robot")
    with pytest.raises(ConfigError, match=r"robot\.yaml:1:1: not UTF-8 text"):
        load_robot(tmp_path)


NESTED = "a: &a [x,x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{b}: &{b} [{','.join([f'*{a}'] * 10)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize("text", ["robot: 2001-13-01", "a: !!bool 5", "[" * 50_000, NESTED, NESTED + "joints: *i"])
def test_what_no_reader_of_yaml_should_meet_is_told_in_a_line(tmp_path, text):
    with pytest.raises(ConfigError, match=r"robot\.yaml") as error:
        load_robot(write(tmp_path, text))
    assert len(str(error.value)) < 600


def test_every_key_is_on_the_page():
    """Write the table anew: python -m tests.plugins.robot.test_description."""
    assert PAGE.read_text(encoding="utf-8") == page()


def page():
    text = PAGE.read_text(encoding="utf-8")
    return text[: text.index("| key |")] + markdown(RobotDescription) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
