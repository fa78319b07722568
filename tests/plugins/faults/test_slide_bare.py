"""Faults without a description: the plant, with 200 mm of a sliding third axis for each radian of joint 3."""

import re
from dataclasses import replace

import numpy as np
import pytest

from cellwatt.tables import write_table
from cellwatt_plugins.faults import api
from cellwatt_plugins.faults.paper.stage import PaperFaultsStage
from cellwatt_plugins.faults.reference import load
from cellwatt_plugins.faults.stage import FaultsStage
from tests.plugins.faults.plant import Cycle, Fault, layout, recorded, run
from tests.plugins.faults.watching import learned, watch

TRAVEL = np.array([1.0, 1.0, 0.2])
OFF = 0.04
"""rad: 8 mm."""


def sliding(cycles, seed):
    channels = list(layout().channels)
    channels[2] = replace(channels[2], unit="m")
    blocks = recorded(cycles, seed=seed)
    by = np.append(TRAVEL, 1.0)
    return [replace(b, layout=replace(b.layout, channels=tuple(channels)), values=b.values * by) for b in blocks]


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    return learned(tmp_path_factory.mktemp("slide") / "reference.yaml", sliding([Cycle()] * 8, seed=50))


@pytest.mark.parametrize("kind", [FaultsStage, PaperFaultsStage])
def test_an_encoder_that_is_off_by_8_mm_is_found_and_told_in_mm(reference, kind):
    cycles = [Cycle()] * 3 + [Cycle(faults=(Fault("encoder_offset", 3, OFF),))] * 2
    alarms = watch(reference, sliding(cycles, seed=2), kind)
    assert {(alarm.kind, alarm.joint) for alarm in alarms} == {("encoder_fault", 3)}
    assert re.search(r"joint 3 is off (the path )?by up to 8\.\d mm, while", alarms[0].statement)


def test_a_table_in_mm_and_a_cell_in_m_have_one_reference(reference, tmp_path):
    position, power, _ = run([Cycle()] * 8, rate=50.0, seed=50)
    q = position * TRAVEL * [1, 1, 1000]
    columns = {"t": np.arange(len(power)) / 50, "q_1": q[:, 0], "q_2": q[:, 1], "q_3 [mm]": q[:, 2], "power": power}
    write_table(tmp_path / "healthy.parquet", columns)
    (by_table,), (by_cell,) = api.reference(tmp_path / "healthy.parquet").reference.tasks, load(reference).tasks
    ways = [[i.displacement for i in task.variants[0].intervals] for task in (by_table, by_cell)]
    assert ways[0] == pytest.approx(np.array(ways[1]), abs=1e-3)
    assert by_table.signature == by_cell.signature
