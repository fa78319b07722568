import numpy as np
import pytest

from cellwatt.errors import ConfigError
from cellwatt_plugins.energy.procedure.cube import SPEEDS, load_cube

SIDE = {"UR5e": 0.4, "UR10e": 0.8, "FR3": 0.4, "Gen3": 0.4}
TABLE_SECONDS = {"UR5e": 168.8 / 4.3669, "UR10e": 534.6 / 6.9176, "FR3": 720.0 / 18.6436, "Gen3": 1133.6 / 29.54}
"""Of a repetition at 50 mm/s: energy over power of the brakes, or of the electronics, in Tables II and III."""


@pytest.mark.parametrize("robot", list(SIDE))
def test_the_points_are_the_corners_of_a_plane_through_the_cube(robot):
    path, side = load_cube(robot).path, SIDE[robot]
    assert np.ptp(path, axis=0) == pytest.approx([side] * 3)
    legs = np.linalg.norm(np.diff(path[1:5], axis=0), axis=1)
    assert legs == pytest.approx([np.sqrt(2) * side, side, np.sqrt(2) * side])
    assert path[0] == pytest.approx((path[4] + path[1]) / 2)
    np.testing.assert_array_equal(path[0], path[5])


@pytest.mark.parametrize("robot", list(SIDE))
def test_a_repetition_takes_as_long_as_in_the_papers_tables(robot):
    cube = load_cube(robot)
    assert cube.seconds(50.0).sum() == pytest.approx(TABLE_SECONDS[robot], rel=0.01)
    for speed in SPEEDS:
        assert 1000 * cube.legs.sum() / cube.seconds(speed).sum() == pytest.approx(speed)


def test_robots_are_found_however_they_are_written():
    assert load_cube("ur5E") == load_cube("UR5e")


def test_a_robot_without_a_cube_is_told_which_there_are():
    with pytest.raises(ConfigError, match=r"'MH12', there are: UR5e, UR10e, FR3, Gen3; give yours with --cube"):
        load_cube("MH12")


def test_a_cube_of_ones_own(tmp_path):
    file = tmp_path / "cubes.yaml"
    file.write_text("small: {payload: 1, points: [[0, 0, 0], [0.2, 0, 0.2], [0.2, -0.2, 0.2], [0, -0.2, 0]]}\n")
    cube = load_cube("small", file)
    assert cube.legs.sum() == pytest.approx(0.4 + 0.4 * np.sqrt(2))
    assert cube.program == "waypoints"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("mine: {payload: 1, points: [[0, 0, 0]]}", r"mine\.points"),
        (
            "mine: {payload: 0, points: [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]]}",
            r"1:17: mine\.payload: found 0, expected a value above 0",
        ),
        ("[", "not valid YAML"),
        ("- mine", r"found a list, expected settings \(key: value\)"),
    ],
)
def test_what_is_wrong_in_a_file_of_cubes(tmp_path, text, said):
    file = tmp_path / "cubes.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=said):
        load_cube("mine", file)
