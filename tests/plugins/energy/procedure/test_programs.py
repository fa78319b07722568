import json
import re

import numpy as np
import pytest

from cellwatt_plugins.energy.procedure.cube import SPEEDS, load_cube
from cellwatt_plugins.energy.procedure.programs import minutes, programs

POSE = re.compile(r"p\[([^\]]+)\]")


def listed(text, name):
    return [float(x) for x in re.search(rf"(?m)^  {name} = \[([^\]]*)\]", text)[1].split(",")]


def test_urscript_goes_through_the_corners_at_the_papers_speeds():
    texts = programs("UR5e", load_cube("UR5e"), SPEEDS, 30)
    assert list(texts) == ["UR5e_0kg.script", "UR5e_5kg.script"]
    text = texts["UR5e_5kg.script"]
    poses = np.array([[float(x) for x in found.split(",")] for found in POSE.findall(text)])
    np.testing.assert_allclose(poses[:, :3], load_cube("UR5e").path[1:], atol=1e-4)
    assert listed(text, "speeds") == [0.05, 0.1, 0.15, 0.2, 0.25]
    assert sum(listed(text, "legs")) == pytest.approx(0.8 + 0.8 * np.sqrt(2), abs=1e-5)
    assert "repetitions = 30" in text
    assert "payload = 5" in text


def test_urscript_opens_and_closes_what_it_opens():
    text = programs("UR10e", load_cube("UR10e"), (100.0,), 2)["UR10e_0kg.script"]
    depth = 0
    for line in text.splitlines():
        word = line.strip()
        depth += word.startswith(("def ", "if ", "while ")) - (word == "end")
        assert depth >= 0
    assert depth == 0
    assert text.count("(") == text.count(")")
    assert "servoj" not in text


@pytest.mark.parametrize("robot", ["FR3", "Gen3"])
def test_waypoints_have_pose_time_and_dwell(robot):
    cube = load_cube(robot)
    content = json.loads(programs(robot, cube, SPEEDS, 30)[f"{robot}_{cube.payload:g}kg.json"])
    assert content["payload"] == cube.payload
    for run in content["runs"]:
        at = [content["poses"]["S"], *(content["poses"][leg["to"]] for leg in run["legs"])]
        path = np.array([pose["position"] for pose in at])
        np.testing.assert_allclose(path, cube.path, atol=1e-6)
        length = np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
        assert 1000 * length / sum(leg["seconds"] for leg in run["legs"]) == pytest.approx(run["speed"], rel=1e-4)
        assert (run["repetitions"], run["dwell_at_start_before_each_repetition"]) == (30, 1.0)
    assert [run["speed"] for run in content["runs"]] == list(SPEEDS)


def test_a_program_of_the_paper_takes_less_than_an_hour():
    # 1.931 m: 38.63, 19.31, 12.88, 9.66, 7.73 s, thirty times, with a second of rest each and ten a speed.
    assert minutes(load_cube("FR3"), SPEEDS, 30) == pytest.approx((88.2 * 30 + 150 + 50) / 60, rel=0.01)
