import json

import numpy as np
import pytest

from cellwatt.errors import ConfigError, ModelError
from cellwatt_plugins.faults import api
from cellwatt_plugins.faults.command import reference
from cellwatt_plugins.faults.reference import load
from cellwatt_plugins.robot.description import PACKAGED
from tests.plugins.faults.plant import Cycle, run
from tests.plugins.faults.watching import called, write_recording


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    positions, power, _ = run([Cycle()] * 5 + [Cycle(speed=0.6)] * 3 + [Cycle(speed=0.4)], rate=100.0, seed=12)
    path = tmp_path_factory.mktemp("healthy") / "healthy.parquet"
    return write_recording(path, np.arange(len(power)) / 100, positions, power)


def test_it_learns_and_says_what(healthy, tmp_path):
    result = called(reference, healthy, "--out", tmp_path / "ref.yaml", "--robot", "plant")
    assert result.exit_code == 0, result.output
    assert result.stdout.splitlines() == [
        "task_1: 5 moves, 5 cycles at speed 1.00, 3 cycles at speed 0.60",
        "1 cycles not used: too few at their speed",
        "whole cycles of task_1: 5 moves, 5 cycles at speed 1.00",
        "whole cycles of task_1: 5 moves, 3 cycles at speed 0.60",
        f"written to {tmp_path / 'ref.yaml'}",
    ]
    assert load(tmp_path / "ref.yaml").robot == "plant"


def test_it_reports_as_json_and_the_robot_may_be_a_description(healthy, tmp_path):
    (tmp_path / "robot.yaml").write_text("robot: irb1200\njoints: []\n")
    words = ("--out", tmp_path / "ref.yaml", "--robot", tmp_path / "robot.yaml", "--json")
    report = json.loads(called(reference, healthy, *words).stdout)
    assert (report["robot"], report["cycles_left_out"]) == ("irb1200", 1)
    assert [v["cycles"] for v in report["tasks"][0]["variants"]] == [5, 3]
    assert load(tmp_path / "ref.yaml").robot == "irb1200"


def test_a_packaged_robot_is_no_mere_name(healthy):
    for robot in ("mh12", PACKAGED / "mh12"):
        with pytest.raises(ModelError, match=r"the recording has 3 joints, robot mh12 has 6"):
            api.reference(healthy, robot=robot)


@pytest.mark.parametrize("missing", ["robots/my-arm", "my-arm.xml", "my-arm.urdf", "my-arm.yaml", "./my-arm"])
def test_a_file_or_folder_that_is_not_there_is_no_mere_name(healthy, tmp_path, monkeypatch, missing):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ConfigError, match="my-arm"):
        api.reference(healthy, robot=missing)
