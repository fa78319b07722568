from pathlib import Path

import numpy as np
import pytest
import yaml
from pydantic import ValidationError

from cellwatt.errors import ConfigError, ModelError
from cellwatt.stage import CellInfo
from cellwatt_plugins.faults import FaultsSettings, FaultsStage
from tests.plugins.faults.plant import Cycle, frames, layout, recorded
from tests.plugins.faults.watching import learned


def made(reference, lay=None, robot=None, **settings):
    cell = CellInfo("plant", "cell", robot, reference.parent)
    return FaultsStage("faults", FaultsSettings(reference=Path(reference.name), **settings), lay or layout(), cell)


def test_a_reference_of_another_robot_is_refused(tmp_path):
    path = learned(tmp_path / "ref.yaml", recorded([Cycle()] * 4), "irb1200")
    assert made(path, robot="irb1200")
    assert made(path)
    with pytest.raises(ModelError, match="is of robot irb1200, the cell's robot is ur10e"):
        made(path, robot="ur10e")
    (tmp_path / "robot.yaml").write_text("robot: irb1200\n")
    assert made(path, robot="robot.yaml")
    assert made(path, robot=str(tmp_path))
    (tmp_path / "robot.yaml").write_text("robot: ur5\n")
    with pytest.raises(ModelError, match="the cell's robot is ur5"):
        made(path, robot="robot.yaml")


def test_a_reference_of_another_number_of_joints_is_refused(reference):
    with pytest.raises(ModelError, match="has 3 joints, source arm has 6"):
        made(reference, layout(joints=6))


def test_the_arm_may_have_another_name_than_when_it_was_learned(reference):
    assert made(reference, layout(arm="left"))
    with pytest.raises(ConfigError, match=r"source 'right' has no joint_1\.position"):
        made(reference, layout(arm="left"), arm="right")


@pytest.mark.parametrize(
    ("content", "text"),
    [
        ({"reference": "a.yaml", "false_alarms": 10}, "a number with its unit, like '10 %'"),
        ({"reference": "a.yaml", "clear": 0}, "greater than or equal to 1"),
    ],
)
def test_wrong_settings_are_refused(content, text):
    with pytest.raises(ValidationError, match=text):
        FaultsSettings.model_validate(content)


def test_memory_stays_bounded_at_rest(reference):
    stage = made(reference)
    for block in frames(np.tile([0.2, -0.8, 0.5], (80_000, 1)), np.full(80_000, 90.0), block=2000):
        stage.process(block, ())
    assert len(stage._cycles._watch._seen.time) <= 62 * 50


def test_a_reference_without_whole_cycles_is_refused(reference, tmp_path):
    content = yaml.safe_load(reference.read_text())
    del content["power_model"], content["cycles"]
    path = tmp_path / "old.yaml"
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(ModelError, match=rf"has no cycles; learn it again with `cellwatt reference .* --out {path}`"):
        made(path)
