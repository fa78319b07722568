"""Rows of frames, against sums that are made value by value here."""

import math
from collections import defaultdict
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydantic import ValidationError

from cellwatt.channel import Quality
from cellwatt.frames import FrameChannel, Layout
from cellwatt.outlets.selection import Picker, Row, Selection
from cellwatt.units import Units
from tests.blocks import frames_of

EPOCH = 1_800_000_000_000_000_000
NAN = math.nan
CHANNELS = (
    FrameChannel("arm.joint_1.position", "rad", "continuous", "linear"),
    FrameChannel("arm.joint_1.temperature", "degC", "continuous", "linear"),
    FrameChannel("arm.mode", "1", "discrete", "hold"),
    FrameChannel("supply.energy", "J", "counter", "hold"),
)
LAYOUT = Layout(CHANNELS, 50.0)
SI = [c.name for c in CHANNELS]


def frames(values, *, first=0, quality=0, at=None):
    """Frames ``first`` … of the grid, or those ``at`` places of it, with ``values`` (n, channels)."""
    table = np.asarray(values, float).reshape(-1, len(CHANNELS))
    numbers = np.arange(first, first + len(table)) if at is None else at
    return frames_of(LAYOUT, first, EPOCH + numbers * LAYOUT.step, table, quality)


def rows(selection, *blocks):
    picker = Picker(selection, LAYOUT)
    return [row for block in blocks for row in picker.rows(block)] + list(picker.rest())


def same(value):
    """A row of four equal values."""
    return [value] * 4


def test_a_row_is_there_with_the_last_frame_of_its_span_and_not_before():
    picker = Picker(Selection(rate=10.0), LAYOUT)
    counts = [len(list(picker.rows(frames([same(float(i))], first=i)))) for i in range(12)]
    assert counts == [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]


def test_units_are_those_that_are_shown():
    picker = Picker(Selection(units=Units(angle="deg", temperature="degF", energy="kWh")), LAYOUT)
    assert picker.units == dict(zip(SI, ("deg", "degF", "1", "kWh"), strict=True))
    (row,) = picker.rows(frames([[math.pi, 100.0, 3.0, 7.2e6]]))
    assert list(row.values.values()) == pytest.approx([180.0, 212.0, 3.0, 2.0])


def test_channels_are_chosen_by_pattern_in_the_order_of_the_frames():
    picker = Picker(Selection(channels=("supply.*", "arm.joint_*", "door.*")), LAYOUT)
    assert list(picker.units) == ["arm.joint_1.position", "arm.joint_1.temperature", "supply.energy"]
    assert picker.unmatched == ("door.*",)
    nothing = Picker(Selection(channels=("door.*",)), LAYOUT)
    assert list(nothing.rows(frames([same(1.0)]))) == []


def test_a_dead_band_holds_back_what_moved_less_since_it_was_told():
    only = Selection(channels=("arm.mode",), rate=50.0, dead_band={"arm.*": 1.0})
    course = [0.0, 0.5, 0.9, 1.0, 1.5, 0.1, 0.0, NAN, NAN, 0.0]
    found = rows(only, frames([same(v) for v in course]))
    told = [(r.sequence, r.values.get("arm.mode"), r.quality["arm.mode"]) for r in found]
    assert told == [(0, 0.0, 0), (3, 1.0, 0), (6, 0.0, 0), (7, None, 4), (9, 0.0, 0)]


def test_a_dead_band_is_in_the_unit_that_is_sent_and_the_first_that_fits_counts():
    bands = {"arm.joint_1.*": 1.0, "arm.*": 0.0}
    chosen = Selection(
        channels=("arm.joint_1.position", "arm.mode"), rate=50.0, units=Units(angle="deg"), dead_band=bands
    )
    found = rows(chosen, frames([same(0.0), same(math.radians(0.9)), same(math.radians(1.1))]))
    assert [set(r.values) for r in found] == [{"arm.joint_1.position", "arm.mode"}, {"arm.mode"}, set(found[0].values)]


@pytest.mark.parametrize("wrong", [{"channels": []}, {"rate": "0 Hz"}, {"dead_band": {"*": -1}}, {"unit": {}}])
def test_settings_that_mean_nothing_are_refused(wrong):
    with pytest.raises(ValidationError):
        Selection.model_validate(wrong)


VALUES = st.one_of(st.floats(-1e6, 1e6), st.just(NAN), st.just(math.inf))


@st.composite
def _courses(draw):
    """Frames with holes, cut into blocks, and a rate of rows."""
    steps = draw(st.lists(st.integers(1, 7), min_size=1, max_size=40))
    at = np.cumsum(steps)
    values = draw(st.lists(st.tuples(*[VALUES] * 4), min_size=len(at), max_size=len(at)))
    quality = draw(st.lists(st.tuples(*[st.integers(0, 3)] * 4), min_size=len(at), max_size=len(at)))
    cuts = sorted(draw(st.sets(st.integers(1, len(at)), max_size=6)) | {0, len(at)})
    return at, np.array(values), np.array(quality), cuts, draw(st.sampled_from([50.0, 40.0, 20.0, 10.0, 7.0, 2.0]))


def _blocks(at, values, quality, cuts):
    return [frames(values[a:b], at=at[a:b], quality=quality[a:b], first=a) for a, b in pairwise(cuts)]


def _key(row: Row):
    return row.sequence, row.time, tuple(row.values.items()), tuple(row.quality.items())


@given(_courses(), st.dictionaries(st.sampled_from(["arm.*", "supply.energy"]), st.floats(0, 1e3)))
def test_blocks_make_no_difference_to_any_bit(course, bands):
    at, values, quality, cuts, rate = course
    chosen = Selection(rate=rate, dead_band=bands)
    assert list(map(_key, rows(chosen, *_blocks(at, values, quality, cuts)))) == list(
        map(_key, rows(chosen, *_blocks(at, values, quality, [0, len(at)])))
    )


@given(_courses())
def test_each_value_is_in_the_one_row_of_its_span(course):
    at, values, quality, cuts, rate = course
    span = round(1e9 / rate)
    by_span = defaultdict(list)
    for i, number in enumerate(at):
        by_span[-(-(EPOCH + int(number) * LAYOUT.step) // span)].append(i)
    found = {row.time: row for row in rows(Selection(rate=rate), *_blocks(at, values, quality, cuts))}
    assert sorted(found) == sorted(number * span for number in by_span)
    assert list(found) == sorted(found)
    for number, members in by_span.items():
        row = found[number * span]
        assert row.sequence == members[-1]
        for column, name in enumerate(SI):
            there = [values[i, column] for i in members if math.isfinite(values[i, column])]
            assert (name in row.values) == bool(there)
            if not there:
                assert row.quality[name] == Quality.MISSING
                continue
            wanted = math.fsum(there) / len(there) if column < 2 else there[-1]
            assert row.values[name] == pytest.approx(wanted, rel=1e-9, abs=1e-6)
            worst = max(quality[i, column] for i in members if math.isfinite(values[i, column]))
            assert row.quality[name] == max(worst, len(there) < len(members))


@given(_courses(), st.floats(1e-3, 1e6))
def test_a_dead_band_never_leaves_a_consumer_further_off_than_itself(course, band):
    at, values, quality, cuts, rate = course
    every = rows(Selection(rate=rate), *_blocks(at, values, quality, cuts))
    told = {r.time: r for r in rows(Selection(rate=rate, dead_band={"*": band}), *_blocks(at, values, quality, cuts))}
    held: dict[str, float | None] = {}
    for row in every:
        if row.time in told:
            sent = told[row.time]
            held |= {name: sent.values.get(name) for name in sent.quality}
        for name in row.quality:
            value = row.values.get(name)
            assert (held[name] is None) == (value is None)
            assert value is None or abs(value - held[name]) < band
