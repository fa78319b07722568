"""An arm whose third axis slides: positions in m, strokes of 30 mm."""

import re

import numpy as np
import pytest

from cellwatt_plugins.faults import api
from cellwatt_plugins.faults.cycles.known import known_of
from cellwatt_plugins.travel import LEVER
from tests.plugins.faults.cycles.conftest import fed, names
from tests.plugins.faults.cycles.four_joints import RATE, STANDBY, TASKS, Cycle, Run, way, write_table
from tests.plugins.robot import scara

HOME = np.array([0.3, 0.5, 0.1])
STROKE = 0.03
MOVES = ({0: 0.9, 1: 0.5}, {2: -STROKE}, {2: STROKE}, {0: -0.4, 1: -0.8}, {2: -STROKE}, {2: STROKE}, {0: -0.5, 1: 0.3})
TASKS["slide"] = (HOME, MOVES)
CONSTANT, RESISTANCE = 20.0, 2.0
FAULTY = 1
"""The second of three cycles."""


def cycles(count: int, seed: int, friction: float = 0.0, off: float = 0.0) -> Run:
    """``count`` cycles; in ``FAULTY``, the slide has ``friction`` N more, and its encoder is ``off`` by m."""
    random = np.random.default_rng(seed)
    parts, spans = [np.repeat(HOME[None], 80, axis=0)], []
    for _ in range(count):
        start, path = sum(map(len, parts)), way(Cycle("slide"), random)[0]
        spans.append((start / RATE, (start + len(path)) / RATE))
        parts += [path, np.repeat(HOME[None], int(random.integers(60, 120)), axis=0)]
    q = np.concatenate(parts)
    time, v = np.arange(len(q)) / RATE, np.gradient(q, 1 / RATE, axis=0)
    faulty = (time >= spans[FAULTY][0] - 0.2) & (time < spans[FAULTY][1] + 0.2)
    torque = scara.torque(q, v, np.gradient(v, 1 / RATE, axis=0))
    torque[:, 2] += friction * faulty * np.tanh(v[:, 2] / 0.004)
    power = STANDBY + (torque * v + RESISTANCE * (torque / CONSTANT) ** 2).sum(axis=1)
    shown = q + random.normal(0.0, 1e-5, q.shape)
    shown[:, 2] += off * faulty
    return Run(time, shown, power + random.normal(0.0, 0.5, len(power)), spans)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    where = tmp_path_factory.mktemp("scara")
    robot = scara.write(where, torque_constant=CONSTANT, winding_resistance=RESISTANCE)
    healthy = write_table(where / "healthy.parquet", cycles(8, seed=1))
    api.reference(healthy, robot=robot).save(where / "reference.yaml")
    return where


@pytest.mark.parametrize(
    ("measured", "fault"),
    [
        (cycles(3, seed=2), []),
        (cycles(3, seed=3, friction=30.0), [(3, "joint")]),
        (cycles(3, seed=4, off=0.006), [(3, "encoder")]),
        (cycles(3, seed=5, off=-0.04), [(3, "encoder")]),
    ],
)
def test_strokes_of_30_mm_are_judged_in_a_recording_and_live(folder, tmp_path, measured, fault):
    where = {"reference": folder / "reference.yaml", "robot": folder / "robot.yaml"}
    found = api.faults(write_table(tmp_path / "cycles.parquet", measured), **where).cycles
    known = known_of(api.load(where["reference"]), where["reference"], where["robot"])
    assert [len(pattern.moves) for pattern in known.patterns] == [len(MOVES)]
    live = [report.finding for report in fed(known, measured) if report.over]
    assert names(found) == names(live) == [[], fault, []]


def test_a_deviation_of_the_slide_is_in_mm(folder, tmp_path):
    table = write_table(tmp_path / "cycles.parquet", cycles(3, seed=4, off=0.006))
    found = api.faults(table, reference=folder / "reference.yaml", robot=folder / "robot.yaml").cycles
    told = re.search(r"joint 3 is off the path by up to (\S+) mm, while", found[FAULTY].faults[0].statement)
    assert told and float(told[1]) == pytest.approx(6.0, abs=1.5)


def test_the_reference_has_metres_for_cycles_and_angles_for_intervals(folder):
    reference = api.load(folder / "reference.yaml")
    (cycle,) = reference.cycles
    assert np.ptp(cycle.position, axis=0) == pytest.approx([0.9, 0.8, STROKE], abs=1e-3)
    assert cycle.repeat.max() < 1e-4
    ways = [interval.displacement[2] for interval in reference.tasks[0].variants[0].intervals]
    assert np.ptp(ways) == pytest.approx(2 * STROKE / LEVER, abs=1e-3)
