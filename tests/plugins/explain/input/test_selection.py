"""Of many recordings those whose motions differ most are looked at closely."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt_plugins.explain.input import selection
from cellwatt_plugins.explain.input.selection import FEW, furthest_first, select
from cellwatt_plugins.explain.input.sources import Source, sources
from cellwatt_plugins.robot import Arm, RobotDescription
from tests.plugins.explain import plant

RATE, SECONDS = 50.0, 4.0


@pytest.fixture(scope="module")
def robot(tmp_path_factory: pytest.TempPathFactory) -> RobotDescription:
    return Arm.load(plant.write_robot(tmp_path_factory.mktemp("robot"))).description


def recorded(folder: Path, *swings: float) -> list[Source]:
    """A recording for each of some swings, rad, of joint 1."""
    time = np.arange(round(SECONDS * RATE)) / RATE
    paths = []
    for i, swing in enumerate(swings):
        columns = {"t": time, "q_1": swing * np.sin(time), "q_2": 0 * time, "q_3": 0 * time}
        columns |= {f"tau_{joint}": 0 * time for joint in (1, 2, 3)}
        paths.append(folder / f"run_{i:02d}.parquet")
        pq.write_table(pa.table(columns), paths[-1])
    return sources(paths, ())


def looked_at(monkeypatch: pytest.MonkeyPatch, seconds: float) -> None:
    """Let as much be looked at with all samples."""
    monkeypatch.setattr(selection, "SAMPLES", seconds * selection.RATE)


def test_of_many_those_that_differ_are_looked_at_in_their_order(
    robot: RobotDescription, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    looked_at(monkeypatch, 3.0 * SECONDS)
    swings = [1.0] * 20
    different = {2: 0.1, 5: 0.3, 11: 1.6, 12: 2.0, 17: 0.6}
    for i, swing in different.items():
        swings[i] = swing
    files = recorded(tmp_path, *swings)
    close, others = select(files, robot)
    assert len(close) == FEW
    names = [file.name for file in close]
    assert {f"run_{i:02d}" for i in different} < set(names)
    assert names == sorted(names)
    assert sorted((*close, *others), key=lambda file: file.name) == files


def test_each_next_one_is_furthest_from_all_before() -> None:
    places = np.random.default_rng(3).normal(size=(40, 5))
    places[7] = places[3]
    order = list(furthest_first(places))
    assert sorted(order) == list(range(40))
    assert order[-1] in (3, 7)
    scaled = places / places.std(axis=0)
    gaps = [min(np.linalg.norm(scaled[i] - scaled[k]) for k in order[:n]) for n, i in enumerate(order) if n]
    assert gaps == sorted(gaps, reverse=True)
