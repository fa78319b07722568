"""Recordings as signals: files of several makes, honest errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt.emulation import load_signals
from cellwatt.errors import RecordingError


def test_csv(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("timestamp,actual_q_0\n10.0,0.5\n10.1,0.7\n10.4,0.1\n")
    signals = load_signals(path)
    np.testing.assert_array_equal(signals.time, [10.0, 10.1, 10.4])
    assert signals.at(np.array([0.05]))["actual_q_0"] == pytest.approx(0.6)
    assert signals.at(np.array([99.0]))["actual_q_0"] == pytest.approx(0.1)
    path.write_text("t,b\n1,2\n")
    with pytest.raises(RecordingError, match="1 rows, expected at least 2"):
        load_signals(path)


def test_parquet(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({"t": [0.0, 1.0, 2.0], "supply.power": [1.0, 2.0, 4.0]}), path)
    signals = load_signals(path, loop=True)
    assert signals.at(np.array([0.5, 2.5]))["supply.power"] == pytest.approx([1.5, 1.5])


def test_channels_of_a_cell_are_found_without_their_source(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,arm.joint_1.position,arm.robot.mode,board.supply.power\n0,1,7,5\n1,2,7,5\n")
    found = load_signals(path).at(np.array([0.5]))
    assert [found[name] for name in ("joint_1.position", "robot.mode", "supply.power")] == [[1.5], [7.0], [5.0]]
    assert not caplog.messages
    path.write_text("t,left.joint_1.position,right.joint_1.position,right.supply.power\n0,1,2,3\n1,1,2,3\n")
    assert {"left.joint_1.position", "supply.power"} <= load_signals(path).columns.keys()
    assert "joint_1.position" not in load_signals(path).columns
    assert "several sources have joint_1.position: only a name with its source is served" in caplog.text


def test_units_below_the_names_count_however_they_are_spelled(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t;joint_1.position;supply.power\ns;degrees;kW\n0;180;1\n1;180;1\n")
    found = load_signals(tmp_path / "a.csv").at(np.array([0.5]))
    assert (found["joint_1.position"], found["supply.power"]) == (pytest.approx([np.pi]), pytest.approx([1000.0]))


def test_cells_without_a_number_are_bridged_and_empty_columns_left_out(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x,y\n0,1,\n1,,\n2,inf,\n3,4,\n")
    signals = load_signals(tmp_path / "a.csv")
    found = signals.at(np.array([1.0, 2.5]))
    assert found.keys() == {"x"}
    assert found["x"] == pytest.approx([2.0, 3.5])
