"""Recordings as signals: files of several makes, honest errors."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt.emulation import load_signals
from cellwatt.errors import RecordingError


@pytest.mark.parametrize("separator", [",", ";", " ", "\t"])
def test_csv_of_each_separator(tmp_path: Path, separator: str) -> None:
    path = tmp_path / "a.csv"
    rows = [["timestamp", "actual_q_0"], ["10.0", "0.5"], ["10.1", "0.7"], ["10.4", "0.1"]]
    path.write_text("\n".join(separator.join(r) for r in rows) + "\n")
    signals = load_signals(path)
    np.testing.assert_array_equal(signals.time, [10.0, 10.1, 10.4])
    assert signals.at(np.array([0.05]))["actual_q_0"] == pytest.approx(0.6)
    assert signals.at(np.array([99.0]))["actual_q_0"] == pytest.approx(0.1)


def test_parquet(tmp_path: Path) -> None:
    path = tmp_path / "a.parquet"
    pq.write_table(pa.table({"t": [0.0, 1.0, 2.0], "supply.power": [1.0, 2.0, 4.0]}), path)
    signals = load_signals(path, loop=True)
    assert signals.at(np.array([0.5, 2.5]))["supply.power"] == pytest.approx([1.5, 1.5])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n", "no column t, timestamp or time for the time; there are: a, b"),
        ("t,b\n1,2\n1,3\n", "does not rise"),
        ("t,b\n1,2,3\n2,3,4\n", "row 2 has 3 cells, expected 2"),
        ("t,b\n1,2\n", "1 rows, expected at least 2"),
    ],
)
def test_bad_files_say_what_is_wrong(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "bad.csv"
    path.write_text(text)
    with pytest.raises(RecordingError, match=message):
        load_signals(path)


@pytest.mark.parametrize("content", [b"", b"t,x\n", b"t,x\n# 1,2\n", b"t,\x81x\n0,1\n1,2\n", b"t,t\n0,1\n1,2\n"])
def test_tables_without_rows_and_names_that_are_no_text(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "a.csv").write_bytes(content)
    with pytest.raises(RecordingError):
        load_signals(tmp_path / "a.csv")


def test_cells_without_a_number_are_bridged_and_empty_columns_left_out(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("t,x,y\n0,1,\n1,,\n2,inf,\n3,4,\n")
    signals = load_signals(tmp_path / "a.csv")
    found = signals.at(np.array([1.0, 2.5]))
    assert found.keys() == {"x"}
    assert found["x"] == pytest.approx([2.0, 3.5])
