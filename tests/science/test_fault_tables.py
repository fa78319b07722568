"""Sabry et al.: criteria (16), the rules under it, the ternary code (20), and fault tables I and II as data."""

import numpy as np
import pytest
from bench.faults.tables import PICK_AND_PLACE, POLISHING, TARGETS

from cellwatt_plugins.faults.criteria import Tolerance, ternary
from cellwatt_plugins.faults.paper.expected import ExpectedInterval, Readings
from cellwatt_plugins.faults.paper.judging import agreement, by_encoders, judge_interval

# Table I as printed: "Time interval", then joints 1 to 6.
TABLE_I = """
First   0  0  0  0  0 -1
Second  0  0  1 -1  1 -1
Third   1 -1  0  0  0  0
Fourth  0  0  1 -1  1 -1
Fifth   1 -1  0  0  1 -1
Sixth   0  0  0  1 -1  1
Target  1 -1  1 -1  1 -1
"""

TABLE_II = """
First   0  0  0  0  0  0
Second  1 -1  0  0  1 -1
Third   1 -1  0  0  0  1
Fourth  1 -1  1 -1  0  0
Fifth   1 -1  0  0  0  1
Sixth   1 -1  1 -1  0  0
Seventh 1 -1  0  0  0  1
Eighth  0  0  1 -1  0  0
Ninth   1 -1  0  0  0  1
Tenth   0  0  0  0  0  0
Target  1 -1  1 -1  1 -1
"""


def printed(table):
    return np.array([[int(x) for x in line.split()[1:]] for line in table.strip().splitlines()])


@pytest.mark.parametrize(("text", "table"), [(TABLE_I, PICK_AND_PLACE), (TABLE_II, POLISHING)])
def test_the_fault_tables_are_those_of_the_paper(text, table):
    rows = printed(text)
    assert np.array_equal(rows[:-1], table)
    assert np.array_equal(rows[-1], TARGETS)


@pytest.mark.parametrize("table", [PICK_AND_PLACE, POLISHING])
@pytest.mark.parametrize("joint", range(1, 7))
def test_each_column_is_explained_by_its_own_joint_alone(table, joint):
    """The result of Table III: the largest output is that of the faulty joint, for every joint."""
    scores = agreement(table[:, joint - 1], table, signed=True)
    assert scores[joint - 1] == 1.0
    assert np.argmax(scores) == joint - 1
    assert np.delete(scores, joint - 1).max() < 1.0


def judged(position, power):
    """An interval of 2 s in which joint 2 is off by ``position`` rad and power by ``power`` W of 100 W."""
    t = np.linspace(0.0, 2.0, 101)
    q = np.column_stack([np.zeros(101), np.where(t < 1.0, t, 2.0 - t)])
    expected = ExpectedInterval(1, (2,), Readings(t, q, np.full(101, 100.0)))
    seen = Readings(t, q + np.array([0.0, position]), np.full(101, 100.0 + power))
    return judge_interval(expected, seen, Tolerance(position=0.015, power=0.10, floor=0.0))


@pytest.mark.parametrize(
    ("position", "power", "kinds"),
    [
        (0.0, 0.0, []),
        (0.020, 0.0, ["encoder"]),  # rule 1
        (0.020, 10.1, ["joint_and_encoder"]),  # rule 2, with its two possibilities
        (0.0, 10.1, []),
    ],
)
def test_rules_under_16(position, power, kinds):
    assert [fault.kind for fault in by_encoders([judged(position, power)])] == kinds


@pytest.mark.parametrize(
    ("position", "power", "free"),
    [
        (0.0, 0.0, True),
        (-0.010, -9.9, True),
        (0.020, 0.0, False),
        (0.0, 10.1, False),
        (0.0, -10.1, False),
        (0.0, 10.0, True),  # at the limit itself
    ],
)
def test_equation_16(position, power, free):
    found = judged(position, power)
    assert (not found.off and not found.power_left) is free


def test_equation_20():
    residual = np.array([-12.0, -10.0, -9.9, 0.0, 9.9, 10.0, 12.0])
    assert ternary(residual, 10.0).tolist() == [-1, 0, 0, 0, 0, 0, 1]
    limits = np.array([11.0, 9.0, 9.0, 9.0, 9.0, 9.0, 13.0])
    assert ternary(residual, limits).tolist() == [-1, -1, -1, 0, 1, 1, 0]
