"""Whatever a command opens: what is no file, or was made to fill the memory, is told in one line and at once."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt import CellwattError
from cellwatt.emulation.signals import load_signals
from cellwatt.errors import RecordingError
from cellwatt.tables import files, read_table
from cellwatt.yaml_file import parse_yaml
from cellwatt_plugins.energy.recordings import read_reading
from cellwatt_plugins.explain.simulators.files import Files
from cellwatt_plugins.faults.paper.network import FaultNetwork
from cellwatt_plugins.models import read_metadata
from cellwatt_plugins.robot.body import Body
from tests.plugins.test_files_of_people import CASES

Read = Callable[[Path], object]
READERS: dict[str, tuple[str, Read]] = {
    **{name: (name, read) for name, read, _, _ in CASES.values()},
    "URDF": ("arm.urdf", lambda path: Body(path, ("joint_1",))),
    "MJCF": ("arm.xml", Files),
    "ONNX": ("power.onnx", read_metadata),
    "fault network": ("faults.onnx", FaultNetwork),
    "campaign's table": ("run.csv", read_reading),
    "campaign's Parquet": ("run.parquet", read_reading),
    "table": ("poses.csv", read_table),
    "Parquet": ("poses.parquet", read_table),
    "signals": ("signals.csv", load_signals),
    "signals' Parquet": ("signals.parquet", load_signals),
}


@pytest.mark.timeout(60)
@pytest.mark.parametrize("kind", ["FIFO", "device", "sparse"])
@pytest.mark.parametrize(("name", "read"), READERS.values(), ids=READERS)
def test_what_is_no_file_of_this_kind(tmp_path: Path, name: str, read: Read, kind: str) -> None:
    path = tmp_path / name
    if kind == "FIFO":
        os.mkfifo(path)
        reason = "a FIFO, expected a file"
    elif kind == "device":
        path.symlink_to("/dev/zero")
        reason = "a device, expected a file"
    else:
        path.touch()
        os.truncate(path, 10_000_000_000)
        reason = "larger than "
    with pytest.raises(CellwattError) as caught:
        read(path)
    said = str(caught.value)
    assert reason.lower() in said.lower()
    assert path.name in said
    assert len(said.splitlines()) == 1


DEEP = "a: " + "[" * 100_000
LAUGHS = "a0: &a0 [x, x]\n" + "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]\n" for i in range(1, 12))
MERGES = "a: &a {}\nb: {" + "<<: *a, " * 180_000 + "}\n"
BOMBS = {"deep": DEEP, "laughs": LAUGHS, "merges": MERGES}
MADE = {f"{name} {bomb}": (name, text) for name in READERS if name.endswith(".yaml") for bomb, text in BOMBS.items()}


@pytest.mark.parametrize(("name", "text"), [*MADE.values(), ("energy.json", "[" * 100_000)], ids=[*MADE, "JSON deep"])
def test_text_that_was_made_to_fill_the_memory(tmp_path: Path, name: str, text: str) -> None:
    file, read = READERS[name]
    path = tmp_path / file
    path.write_text(text)
    with pytest.raises(CellwattError) as caught:
        read(path)  # followed, it would never end
    assert len(str(caught.value).splitlines()) == 1


def test_a_parquet_file_that_unpacks_to_more_than_it_may(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A column of one value takes no room in the file."""
    path = tmp_path / "moves.parquet"
    rows = 1_000_000
    column = pa.DictionaryArray.from_arrays(np.zeros(rows, np.int32), pa.array([1.0]))
    pq.write_table(pa.table({"t": column, "q_1": column}), path)
    assert path.stat().st_size < 10_000
    assert read_table(path).names == ("q_1",)
    monkeypatch.setattr(files, "LARGEST", 15_000_000)
    with pytest.raises(RecordingError, match=r"would take more than 15,000,000 bytes of memory"):
        read_table(path)


def test_what_people_write_is_read() -> None:
    assert parse_yaml("a: &x {k: [1, 2]}\nb: {<<: *x, c: *x}\n") == {
        "a": {"k": [1, 2]},
        "b": {"k": [1, 2], "c": {"k": [1, 2]}},
    }
