"""The law and the table of bench/scale.py, by figures made up for the test, and its recordings."""

from __future__ import annotations

from pathlib import Path

import pyarrow.parquet as pq
import pytest
from scaling import page
from scaling.law import Law
from scaling.overheads import Overheads
from scaling.recordings import make, simulation_of

STAGES = [
    {"what": "reading", "tasks": 100, "seconds": 60.0, "longest": 0.6, "bytes": 2_000_000, "shared": 0},
    {"what": "trying", "tasks": 50, "seconds": 30.0, "longest": 2.0, "bytes": 0, "shared": 8_000_000},
]
INSIDE = {"seconds": 100.0, "stages": STAGES}
FREE = Overheads(0.0, 0.0, 0.0)


def test_without_overheads_and_with_small_tasks_amdahls_law_is_left():
    small = {**INSIDE, "stages": [{**each, "longest": 0.0} for each in STAGES]}
    law = Law.of(small, FREE)
    assert law.seconds(None) == law.seconds(1) == pytest.approx(100.0)
    assert law.seconds(2) == pytest.approx(10.0 + 45.0)
    assert law.seconds(90) == pytest.approx(10.0 + 1.0)


def test_a_stage_takes_as_long_as_its_longest_task():
    assert Law.of(INSIDE, FREE).seconds(1000) == pytest.approx(10.0 + 1.5 * 0.6 + 1.5 * 2.0)


def test_start_tasks_and_bytes_do_not_shrink_with_the_workers():
    costs = Overheads(3.0, 0.01, 1e-8)
    assert Law.of(INSIDE, costs).seconds(8) - Law.of(INSIDE, FREE).seconds(8) == pytest.approx(3.0 + 1.5 + 0.1)


def test_what_one_worker_took_beyond_the_parts_is_made_by_each():
    law = Law.of(INSIDE, FREE).beside(serial=104.0, one=112.0)
    assert law.seconds(None) == pytest.approx(104.0)
    assert law.seconds(1) == pytest.approx(112.0)
    assert law.seconds(4) - Law.of(INSIDE, FREE).seconds(4) == pytest.approx(12.0)
    assert Law.of(INSIDE, FREE).beside(serial=100.0, one=90.0).anew == 0.0


def test_the_table_has_measured_ratios_beside_the_law():
    run = {"computing": 1.0, "digest": "", "found": ["payload"]}
    ways = {"serial": 90.0, "local:1": 93.0, "local:2": 50.0}
    law = Law.of(INSIDE, FREE)
    result = {
        "recordings": 3,
        "seconds": 30.0,
        "same_bytes": True,
        "runs": {name: [{**run, "seconds": seconds}] for name, seconds in ways.items()},
        "inside": INSIDE,
        "overheads": {"start": 3.0, "task": 0.01, "byte": 1e-8, "anew": 0.0},
        "law": {str(w): law.seconds(w) for w in (1, 2, 64)} | {"serial": law.seconds(None)},
    }
    lines = page.markdown(result).splitlines()
    assert lines[0] == "3 recordings of 30 s; findings.json and model.yaml are the same bytes"
    assert "| local:2 | 50.0 (50.0 … 50.0) | 1.0 (1.0 … 1.0) | 1.80 (1.80 … 1.80) | payload |" in lines
    assert lines[-1] == "| measured | 0.97 | 1.80 | – |"


def test_recordings_are_made_once_with_their_simulations(tmp_path: Path):
    made = make(tmp_path, 2, 4.0)
    tables = [pq.read_table(path) for path in (*made, *map(simulation_of, made))]
    assert all(table["t"].to_numpy()[-1] == pytest.approx(4.0, abs=0.05) for table in tables)
    before = made[0].stat().st_mtime_ns
    assert make(tmp_path, 2, 4.0) == made and made[0].stat().st_mtime_ns == before
