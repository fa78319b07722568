"""Sabry et al.: the data change detector finds the 6 intervals of Table I and the 10 of Table II (Fig. 9, 16, 17)."""

from pathlib import Path

import numpy as np
import pytest

from cellwatt.results import Interval
from cellwatt.stage import CellInfo
from cellwatt_plugins.segment import SegmentSettings, SegmentStage
from tests.plugins.faults.paper.irb1200 import (
    BOUNDARIES,
    LENGTH,
    PICK_AND_PLACE_AS_TIMED,
    POLISHING_WITHOUT_RESTS,
    Run,
    period,
    run,
)
from tests.plugins.faults.plant import START, frames
from tests.science.test_fault_tables import TABLE_I, TABLE_II, printed

REST = 0.6  # s before and after a task


def closed_intervals(told, rate):
    blocks = frames(told.q, told.power, rate=rate, block=10)
    stage = SegmentStage("segment", SegmentSettings(), blocks[0].layout, CellInfo("plant", "cell", None, Path()))
    found = [result for frames in blocks for result in stage.process(frames, ())] + list(stage.close())
    return [result for result in found if isinstance(result, Interval) and result.closed]


def one_cycle(moves, speed, rate):
    """One task between two rests."""
    told = run(Run(moves, 2, speed, lead=REST, rate=rate))
    part = told.t < REST + period(moves, speed) - 1e-9
    still = round(REST * rate)
    q = np.vstack([told.q[part], told.q[:still]])
    t = np.arange(len(q)) / rate
    return type(told)(t, q, np.concatenate([told.power[part], told.power[:still]]))


def moving_sets(table):
    return [tuple((np.flatnonzero(row) + 1).tolist()) for row in printed(table)[:-1]]


@pytest.mark.parametrize("rate", [50.0, 123.0])
def test_pick_and_place_has_the_six_intervals_of_table_i(rate):
    """Its first and its last row have codes: the task is what lies between the two rests."""
    before, *found, after = closed_intervals(one_cycle(PICK_AND_PLACE_AS_TIMED, 1.0, rate), rate)
    assert not before.moving
    assert not after.moving
    assert len(found) == 6
    assert [i.moving for i in found] == moving_sets(TABLE_I)
    ends = [(i.end - START) * 1e-9 - REST for i in found]
    assert ends == pytest.approx([*BOUNDARIES, LENGTH], abs=0.08)


@pytest.mark.parametrize("rate", [50.0, 123.0])
def test_polishing_has_the_ten_intervals_of_table_ii(rate):
    """Its first and its last row have no code: the rests before and after are intervals of the task."""
    found = closed_intervals(one_cycle(POLISHING_WITHOUT_RESTS, 1.0, rate), rate)
    assert len(found) == 10
    assert [i.moving for i in found] == moving_sets(TABLE_II)


@pytest.mark.parametrize(("moves", "table"), [(PICK_AND_PLACE_AS_TIMED, TABLE_I), (POLISHING_WITHOUT_RESTS, TABLE_II)])
def test_the_same_joints_move_at_half_speed(moves, table):
    """Where slow moves meet, this plant is at rest for longer than 0.12 s: such a rest is an interval more."""
    found = closed_intervals(one_cycle(moves, 0.5, 50.0), 50.0)
    assert [i.moving for i in found if i.moving] == [row for row in moving_sets(table) if row]
