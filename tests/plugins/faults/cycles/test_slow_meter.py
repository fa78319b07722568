"""Faults told from a power meter of ten values a second, each a mean and late."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from cellwatt.errors import ModelError
from cellwatt_plugins.faults.command import reference
from cellwatt_plugins.faults.cycles.bare_arm import BareArm
from cellwatt_plugins.faults.cycles.findings import TOO_SLOW, judge_recording
from cellwatt_plugins.faults.cycles.known import learn_known, restored, stored
from cellwatt_plugins.faults.cycles.learn import learn_patterns
from cellwatt_plugins.faults.cycles.live import CycleWatch
from cellwatt_plugins.faults.cycles.recording import Recording
from tests.plugins.faults.cycles.conftest import HEALTHY, fed, names
from tests.plugins.faults.cycles.four_joints import Cycle, Fault, describe, run
from tests.plugins.faults.watching import called, write_recording
from tests.plugins.robot.slow_meter import shown

WINDOW, LATE = 0.1, 0.15
CYCLES = [
    Cycle("A"),
    Cycle("B", faults=(Fault("friction", 1, 1.0),)),
    Cycle("A", pause=1.0),
    Cycle("A", faults=(Fault("spring", 2, 40.0),)),
    Cycle("B"),
    Cycle("B", faults=(Fault("encoder_offset", 0, 0.04),)),
    Cycle("A"),
]
NAMED = [[], [(2, "joint")], [], [(3, "joint")], [], [(1, "encoder")], []]


def through(measured, phase: float) -> Recording:
    power = shown(measured.time, measured.power, WINDOW, LATE, phase=phase)
    return Recording(measured.time, measured.position, power)


@pytest.fixture(scope="module")
def known(robot):
    return learn_known(through(run(HEALTHY, seed=1), 0.4), robot)


@pytest.fixture(scope="module")
def recording():
    return through(run(CYCLES, seed=20), 0.8)


def test_the_meter_is_reported(tmp_path):
    healthy = through(run(HEALTHY, seed=1), 0.4)
    table = write_recording(tmp_path / "healthy.parquet", healthy.time, healthy.position, healthy.power)
    said = called(reference, table, "--robot", describe(tmp_path), "--out", tmp_path / "reference.yaml").stdout
    of_meter = (
        r"^power is from a slow meter \(averaged over (\d+) ± \d+ ms and delayed by (\d+) ± \d+ ms\): compared with"
    )
    window, late = map(int, re.search(of_meter, said, re.MULTILINE).groups())
    assert (window, late) == (pytest.approx(1000 * WINDOW, abs=10), pytest.approx(1000 * LATE, abs=10))


def test_the_reference_file_keeps_the_meter(known, recording, robot):
    again = restored(*stored(known, robot), robot)
    assert again.meter is not None
    assert again.meter.window == pytest.approx(known.meter.window, abs=1e-6)
    assert names(judge_recording(recording, again)) == NAMED


def test_live_as_in_a_recording(known, recording):
    """A cycle is told once its last values are there."""
    watch = CycleWatch(known, recording.step)
    over = []
    for first in range(0, len(recording.time), 5):
        part = slice(first, first + 5)
        for each in watch.feed(recording.time[part], recording.position[part], recording.power[part]):
            if each.over:
                over.append(each.finding)
                assert recording.time[part][-1] - each.finding.end > WINDOW + LATE
    over += [each.finding for each in watch.close() if each.over]
    assert names(over) == NAMED
    assert watch.behind == pytest.approx(WINDOW + LATE, abs=0.02)


def test_a_meter_slower_than_a_cycle_is_told_as_such(known, recording):
    slow = replace(known, meter=replace(known.meter, window=9.0, interval=9.0))
    held = Recording(recording.time, recording.position, shown(recording.time, recording.power, 9.0, LATE))
    assert {each.finding.note for each in fed(slow, held)} == {TOO_SLOW}
    assert {cycle.note for cycle in judge_recording(held, slow)} == {TOO_SLOW}


def test_cycles_shorter_than_the_window_of_the_meter_are_not_learnt(known):
    healthy = run(HEALTHY, seed=1)
    held = shown(healthy.time, healthy.power, 9.0, LATE)
    meter = replace(known.meter, window=9.0, interval=9.0)
    with pytest.raises(ModelError, match=r"task_1: fewer than 2 values of the power meter .* over 9 s"):
        learn_patterns(Recording(healthy.time, healthy.position, held, meter))


def test_a_bare_arm_is_judged_by_a_slow_meter(recording):
    bare = learn_known(through(run(HEALTHY, seed=1), 0.4), BareArm(np.ones(recording.joints)))
    assert bare.meter is not None
    assert bare.meter.window == pytest.approx(WINDOW, abs=0.02)
    assert [bool(named) for named in names(judge_recording(recording, bare))] == [bool(named) for named in NAMED]
