"""Links whose masses a URDF leaves out, as makers' ROS packages do: said before anything is computed."""

import re

import pytest

from cellwatt.errors import ConfigError
from cellwatt_plugins.models.static.planning import write_plan
from cellwatt_plugins.robot import Arm
from tests.plugins.explain.recorded_arm import write_robot


def massless(folder, *links):
    """The arm without the ``<inertial>`` of some links, from 1."""
    path = write_robot(folder)
    text = (folder / "bench.urdf").read_text()
    for link in links:
        text = re.sub(rf'(<link name="link_{link}">)<inertial>.*?</inertial>', r"\1", text)
    (folder / "bench.urdf").write_text(text)
    return path


@pytest.mark.parametrize("links", [(1, 2, 3, 4, 5, 6), (3, 4)])
def test_links_without_mass_are_named(tmp_path, links):
    with pytest.raises(ConfigError) as caught:
        Arm.load(massless(tmp_path, *links))
    named = ", ".join(f"link_{link}" for link in links)
    assert f"bench.urdf: no mass of {named}: without it" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_flange_or_a_link_between_two_axes_at_one_place_may_have_none(tmp_path):
    path = massless(tmp_path, 4, 6)
    urdf = tmp_path / "bench.urdf"
    urdf.write_text(urdf.read_text().replace('<origin xyz="0.3 0 0"/>', '<origin xyz="0 0 0.001"/>'))
    arm = Arm.load(path)
    assert arm.body.without_mass() == ()


def test_planning_of_motion_needs_no_masses(tmp_path):
    plan = write_plan(massless(tmp_path, 1, 2, 3, 4, 5, 6), 4, tmp_path / "plan")
    assert (tmp_path / "plan" / "plan.csv").exists()
    assert plan.robot == "bench"
