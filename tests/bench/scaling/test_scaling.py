"""Recordings and table of bench/scale.py."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq
import pytest
from scale import table
from scaling.product import Measured
from scaling.recordings import make, simulation_of


def test_the_table_has_the_ratio_beside_serial_work():
    ways = {"serial": (90.0, 92.0, 88.0), "local:2": (50.0, 50.0, 50.0)}
    runs = {name: [Measured(seconds, 1.0, "", ("payload",)) for seconds in each] for name, each in ways.items()}
    assert table(runs).splitlines()[-1] == "| local:2 | 50.0 (50.0 … 50.0) | 1.0 | 1.80 | payload |"


def test_recordings_are_made_once_with_their_simulations(tmp_path: Path):
    made = make(tmp_path, 2, 4.0)
    tables = [pq.read_table(path) for path in (*made, *map(simulation_of, made))]
    assert all(table["t"].to_numpy()[-1] == pytest.approx(4.0, abs=0.05) for table in tables)
    before = made[0].stat().st_mtime_ns
    assert make(tmp_path, 2, 4.0) == made and made[0].stat().st_mtime_ns == before
