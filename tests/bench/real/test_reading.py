"""Rows of the UR10e's files that are damaged."""

import numpy as np
from real import ur10e


def rows(count: int) -> list[str]:
    return [",".join(f"{value:.4f}" for value in [500 + 0.01 * i, *np.full(30, 0.1)]) for i in range(count)]


def test_damaged_rows_are_dropped_and_counted(tmp_path):
    lines = rows(20)
    lines[5] = lines[5].rsplit(",", 10)[0]
    lines[7] = lines[7].replace("0.1000", "1e250", 1)
    lines[9] = lines[9].replace("0.1000", "0.1.0", 1)
    lines[11] = lines[3]
    (tmp_path / ur10e.FOLDER).mkdir()
    (tmp_path / ur10e.FOLDER / "some.csv").write_text("\n".join(lines))
    recording = ur10e.read(tmp_path, "some")
    assert (recording.dropped, len(recording.time)) == (4, 16)
    assert recording.time[0] == 0.0
    assert np.all(np.diff(recording.time) > 0)
