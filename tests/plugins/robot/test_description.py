import re
from pathlib import Path

import pytest
import yaml

from cellwatt.errors import ConfigError
from cellwatt_plugins.robot import RobotDescription, load_robot
from tests.docs.pages import settings_table

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
    assert robot.standby_power == 81.0
    first, second = robot.joints
    assert (first.name, first.gear_ratio, first.torque_constant, first.winding_resistance) == ("a", 101.0, 12.5, 0.6)
    assert (second.gear_ratio, second.torque_constant, second.coulomb_friction) == (1.0, 0.0, 0.0)
    assert second.velocity_limit is None
    assert robot.tolerances.friction == 0.06


def rod(**changes):
    return {"link": 1, "from": [0, 0, 0], "to": [0, 0, 1], "radius": 0.1, **changes}


def joint(**changes):
    return {**WHOLE, "joints": [{**JOINTS[0], **changes}]}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({key: value for key, value in WHOLE.items() if key != "urdf"}, "the key 'urdf' is missing"),
        ({**WHOLE, "joints": [JOINTS[1], JOINTS[1]]}, "two joints have the same name"),
        ({**WHOLE, "torque_from": "motor"}, "torque_from: found 'motor', expected 'current' or 'sensor'"),
        (
            {**WHOLE, "payload": 3, "payloads": 4},
            "payloads: unknown key 'payloads'; did you mean 'payload'? (keys here: ",
        ),
        (joint(lower_limit=2, upper_limit=-2), "joints[0].lower_limit: found 2, expected less than upper_limit, -2"),
        ({**WHOLE, "capsules": [rod(link=4)]}, "capsules: a link above 2, the last"),
        (joint(coulomb_friction=float("nan")), "joints[0].coulomb_friction: found .nan, expected a finite number"),
    ],
)
def test_a_mistake_is_one_line_with_its_place(tmp_path, content, message):
    path = write(tmp_path, content)
    with pytest.raises(ConfigError) as caught:
        load_robot(path)
    assert re.match(rf"{re.escape(str(path))}:\d+:\d+: ", str(caught.value))
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_keys_of_ones_own_are_reported_and_not_used(tmp_path, caplog):
    keys = {"serial_number": "12", "sample_rate": 125}
    description = load_robot(write(tmp_path, {**joint(coulomb=4, name="elbow"), **keys}))
    assert description.joints[0].coulomb_friction == JOINTS[0].get("coulomb_friction", 0)
    assert [message.partition("robot.yaml: ")[2].partition(" (keys")[0] for message in caplog.messages] == [
        "unknown key 'serial_number'",
        "elbow: unknown key 'coulomb'; did you mean 'coulomb_friction'?",
    ]


def test_every_key_is_on_the_page():
    """Write the table anew: python -m tests.plugins.robot.test_description."""
    assert PAGE.read_text(encoding="utf-8") == page()


def page():
    text = PAGE.read_text(encoding="utf-8")
    return text[: text.index("| key |")] + settings_table(RobotDescription) + "\n"


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
