from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.special import polygamma

from cellwatt_plugins.fleet.adjusted import Course, Observations, Warmth, course_of, shrunk, warmth_of
from cellwatt_plugins.fleet.api import _smallest, _summary
from cellwatt_plugins.fleet.courses import CellJoint, Courses, observations_of
from cellwatt_plugins.fleet.judge import judged
from cellwatt_plugins.fleet.kinds import common_course, less_common, moderated, spread_of
from cellwatt_plugins.fleet.slopes import trends_of
from cellwatt_plugins.fleet.trend import line, persistence, rather_a_step, steps_in
from cellwatt_plugins.fleet.weekly import Repetition, Week
from cellwatt_plugins.robot import Joint, RobotDescription

WEEKS = np.arange(100, 126)


def wandering(rng, rho=0.5, scatter=0.02, error=0.01, weeks=WEEKS):
    """A course without a trend: weeks that remember the one before, and errors of their own."""
    values, last = np.empty(len(weeks)), scatter * rng.standard_normal()
    for i in range(len(weeks)):
        last = rho * last + scatter * np.sqrt(1 - rho**2) * rng.standard_normal() if i else last
        values[i] = last + error * rng.standard_normal()
    return Course(weeks, values, error**2 * np.eye(len(weeks)))


def test_slopes_are_within_their_errors_as_often_as_they_say():
    rng = np.random.default_rng(1)
    lines = [line(wandering(rng), 0.6) for _ in range(200)]
    pulls = np.array([each.slope / each.error for each in lines])
    assert np.mean(np.abs(pulls) < 2.06) == pytest.approx(0.95, abs=0.05)


def test_weeks_that_remember_are_told_from_weeks_that_do_not():
    rng = np.random.default_rng(2)
    assert persistence([wandering(rng, rho=0.0) for _ in range(25)]) <= 0.3
    assert persistence([wandering(rng, rho=0.8, error=0.003) for _ in range(25)]) >= 0.7


def test_a_step_is_found_in_its_week_and_none_in_a_slope():
    rng = np.random.default_rng(3)
    sound = wandering(rng)
    fallen = Course(WEEKS, sound.values - 0.3 * (WEEKS >= 114), sound.covariance)
    (step,) = steps_in(fallen, 0.4, 1e-5)
    assert step.week == 114
    assert step.size == pytest.approx(-0.3, abs=0.08)
    assert steps_in(rising(sound, 0.3), 0.4, 1e-5) == []
    assert rather_a_step(rising(sound, 0.3), 0.4, 1e-9) is None
    assert abs(rather_a_step(fallen, 0.4, 1e-9).week - 114) <= 1
    after = line(fallen, 0.4, [step])
    assert (after.first, after.last) == (114, 125)


def test_weeks_that_are_calm_by_accident_make_no_step_sure():
    rng = np.random.default_rng(13)
    calm = wandering(rng, scatter=0.002, error=0.001)
    small = Course(WEEKS, calm.values + 0.03 * (WEEKS >= 113), calm.covariance)
    assert [step.week for step in steps_in(small, 0.4, 1e-5)] == [113]
    assert steps_in(small, 0.4, 1e-5, scatter=0.02) == []


def test_a_season_is_common_and_one_arm_of_many_does_not_move_it():
    rng = np.random.default_rng(5)
    season = 0.1 * np.sin(WEEKS / 8)
    courses = {i: wandering(rng, scatter=0.005, error=0.002).less(-season - 0.3 * i) for i in range(9)}
    courses[4] = courses[4].less(-0.02 * (WEEKS - 100))
    common = common_course(courses)
    assert np.abs(common.values - (season - season.mean())).max() < 0.02
    left = less_common(courses[4], common)
    assert left.values[-1] - left.values[0] == pytest.approx(0.5, abs=0.05)
    assert common_course({i: courses[i] for i in range(4)}) is None


def test_how_far_sound_arms_are_apart_is_told_beside_a_few_that_are_not():
    rng = np.random.default_rng(6)
    slopes = np.hypot(0.01, 0.02) * rng.standard_normal(300)
    slopes[:9] = 1.0
    assert spread_of(slopes.tolist(), [0.01] * 300) == pytest.approx(0.02, rel=0.15)
    assert spread_of([0.001] * 20, [0.01] * 20) == 0.0


def rising(course, rise):
    """The course with a line that rises by ``rise`` from the first week to the last."""
    return course.less(-rise * (WEEKS - 100) / 25)


def halls(rng, rises):
    """Arms in halls that raise friction of all their joints by ``rises`` from the first week to the last."""
    return {
        CellJoint(f"weld-{i:02d}", joint): rising(wandering(rng), rise)
        for i, rise in enumerate(rises)
        for joint in range(1, 7)
    }


def fleet_of(rng, worn, arms=12):
    courses = halls(rng, np.zeros(arms))
    courses[worn] = rising(courses[worn], 0.3)
    return [Courses("welder", "friction", True, courses)]


def test_the_worn_joint_alone_is_sure():
    (found,) = judged(fleet_of(np.random.default_rng(7), worn=CellJoint("weld-03", 2)), 0.01, 0.05)
    assert found.sure == {CellJoint("weld-03", 2)}
    trend = found.trends[CellJoint("weld-03", 2)]
    low, high = (end * trend.span for end in trend.interval())
    assert low < 0.3 < high
    assert not found.steps


def test_six_weeks_of_four_joints_tell_no_smallest_rise():
    rng = np.random.default_rng(18)
    courses = {CellJoint("scara", joint): wandering(rng, weeks=WEEKS[:6]) for joint in range(1, 5)}
    (found,) = judged([Courses("scara", "friction", False, courses)], 0.01, 0.05)
    assert len(found.trends) == 4
    assert _smallest([found]) == {}
    (more,) = judged(fleet_of(rng, worn=CellJoint("weld-03", 2)), 0.01, 0.05)
    assert 1 < _smallest([more])["welder (with temperature)"] < 30


def trends_in(courses):
    return trends_of(courses, dict.fromkeys(courses, ()), 0.5)


def test_joints_of_arms_in_unlike_halls_are_as_sure_as_they_say():
    rng = np.random.default_rng(14)
    fleets = [trends_in(halls(rng, 0.12 * rng.standard_normal(20))) for _ in range(3)]
    chances = np.array([each.chance for trends in fleets for each in trends.values()])
    assert np.mean(chances < 0.05) == pytest.approx(0.05, abs=0.03)
    assert chances.min() > 1e-4


def test_a_worn_joint_is_told_beside_the_others_of_its_arm():
    rng = np.random.default_rng(15)
    rises = 0.12 * rng.standard_normal(20)
    rises[3] = -0.2
    courses, worn = halls(rng, rises), CellJoint("weld-03", 2)
    courses[worn] = rising(courses[worn], 0.3)
    trends = trends_in(courses)
    found = trends.pop(worn)
    assert found.slope * 25 == pytest.approx(0.3, abs=0.06)
    assert found.chance < 1e-5
    assert min(each.chance for each in trends.values()) > 1e-4


def test_an_arm_that_changes_by_more_than_halls_differ_is_told():
    rng = np.random.default_rng(16)
    rises = 0.02 * rng.standard_normal(20)
    rises[5] = 0.5
    sure = {place for place, each in trends_in(halls(rng, rises)).items() if each.chance < 1e-5}
    assert sure == {CellJoint("weld-05", joint) for joint in range(1, 7)}


def observed(rng, slope=-0.01, wear=0.0):
    """Two programs whose mix turns over, in a hall that becomes warmer."""
    week = np.repeat(np.arange(26), 3)
    program = (rng.random(len(week)) < week / 25).astype(int)
    warmth = 20 + 0.4 * week + 3 * rng.standard_normal(len(week))
    values = slope * (warmth - 20) + wear * week / 25 - 0.08 * program + 0.01 * rng.standard_normal(len(week))
    return Observations(values, week, np.arange(len(week)), program, warmth)


def test_programs_and_temperature_are_taken_out():
    rng = np.random.default_rng(8)
    told = observed(rng, wear=0.1)
    found = warmth_of(told, 0.1)
    assert found.slope == pytest.approx(-0.01, abs=4 * found.error)
    course = course_of(told, 0.1, 0.01, shrunk([found])[0], 20.0)
    rise = line(course, 0.0)
    assert rise.slope * 25 == pytest.approx(0.1, abs=4 * rise.error * 25)
    assert 4 * rise.error * 25 < 0.05
    assert np.polyfit(told.week, told.values, 1)[0] * 25 < 0.0


def test_temperature_that_is_not_sure_to_count_is_left_alone():
    rng = np.random.default_rng(9)
    assert shrunk([warmth_of(observed(rng, slope=0.0), 0.1) for _ in range(3)]) == [Warmth(0.0, 0.0)] * 3
    slopes = [each.slope for each in shrunk([warmth_of(observed(rng), 0.1) for _ in range(6)])]
    assert np.ptp(slopes) < 0.001
    assert np.mean(slopes) == pytest.approx(-0.01, abs=0.001)


def test_what_is_not_known_of_temperature_grows_with_the_season():
    rng = np.random.default_rng(17)
    week = np.arange(26)
    pulls = []
    for _ in range(100):
        off = 0.002 * rng.standard_normal()
        warmth = 20 + 0.6 * week
        told = Observations(off * warmth + 0.01 * rng.standard_normal(26), week, week, np.zeros(26, int), warmth)
        rise = line(course_of(told, 0.05, 0.01, Warmth(0.0, 0.002), 20.0), 0.0)
        pulls.append(rise.slope / rise.error)
    assert np.std(pulls) == pytest.approx(1.0, abs=0.2)


def test_a_joint_without_friction_is_not_said_to_rest():
    """The first joint's torque has the wrong sign, the second one hardly moves."""
    nothing, speed = np.full(2, np.nan), np.array([0.4, np.nan])
    each = Repetition(0, (1.0, 2.0, 0.0), np.array([1.0, np.nan]), None, None)
    weeks = [Week("a", w, np.array([-3.0, np.nan]), nothing * 0, speed, (each,), (), 20.0) for w in range(6)]
    robot = RobotDescription(robot="a", urdf=Path("a"), joints=(Joint(name="j1"), Joint(name="j2")))
    said = _summary("a", robot, weeks, observations_of(weeks)).statement
    assert said == "hardly moves: j2; torque does not oppose the motion (constant, or of the wrong sign): j1"


def test_the_thousandth_recording_of_a_week_is_not_the_first_of_the_next():
    speed = np.array([0.4])
    each = [Repetition(n, (1.0, 2.0), np.ones(1), None, None) for n in (1000, 0)]
    weeks = [Week("a", w, speed, speed, speed, (one,), (), 20.0) for w, one in zip((5, 6), each, strict=True)]
    assert observations_of(weeks)["friction", 1].week.tolist() == [5, 6]


def test_variances_that_hardly_differ_add_no_more_than_the_most_free():
    free = np.full(8, 20.0)
    spread = np.sqrt((polygamma(1, 10.0) + np.array([-1e-3, 1e-9, 1e-3])) * 7 / 8)
    found = [moderated(np.exp(each * np.array([-1.0, 1.0] * 4)), free)[1] for each in spread]
    assert [each.tolist() for each in found] == [[80.0] * 8] * 3


def test_few_arms_without_temperature_are_judged_alone():
    (group,) = fleet_of(np.random.default_rng(11), worn=CellJoint("weld-01", 2), arms=2)
    (found,) = judged([replace(group, with_temperature=False)], 0.01, 0.05)
    assert found.alone
    assert found.sure == {CellJoint("weld-01", 2)}
