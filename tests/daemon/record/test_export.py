import json

import numpy as np
import pyarrow.parquet as pq
import pytest

from cellwatt import Event, RecordingError, Tick
from cellwatt.commands.export import command
from cellwatt.emulation import load_signals
from cellwatt.tables import read_table
from tests.calling import called

from .making import METER, SESSION, batch_of, frames_of, name_of, write_chunks
from .test_roundtrip import RESULTS


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "rec").mkdir()
    for number, first in ((1, 0), (2, 20)):
        items = [batch_of(first, 15), batch_of(first + 15, 5), frames_of(first, 10), Tick(SESSION)]
        items.append(batch_of(first, 20, stream=METER, source="supply", device=False))
        write_chunks(tmp_path / "rec", [items, [*RESULTS, Event(SESSION, "arm", "connected", "up")]], number=number)
    return tmp_path / "rec"


def test_parquet_has_the_recorded_values_names_and_units(folder, tmp_path):
    report = json.loads(called(command, folder, "--out", tmp_path / "out", "--json"))
    assert {f["file"]: f["rows"] for f in report["files"]} == {
        "arm.rtde.parquet": 40,
        "supply.meter.parquet": 40,
        "frames.parquet": 20,
        "results.jsonl": 10,
        "events.jsonl": 2,
    }
    assert report["damage"] == [] and report["start"] == SESSION
    table = pq.read_table(tmp_path / "out" / "arm.rtde.parquet")
    for i in range(6):
        name = f"joint_{i + 1}.position"
        assert np.array_equal(table[name], batch_of(0, 40).values[:, i])
        assert table.schema.field(name).metadata == {b"unit": b"rad"}
    assert table["utc_ns"].to_pylist() == [SESSION + n * 2_000_000 for n in range(40)]
    assert table["t"].to_pylist() == [n * 2_000_000 / 1e9 for n in range(40)]
    assert table["sequence"].to_pylist() == list(range(40))
    assert table["device_time_ns"].to_pylist() == [n * 2_000_000 + 17 for n in range(40)]
    assert table["arrival_ns"].to_pylist()[14:16] == [batch_of(0, 15).arrival, batch_of(15, 5).arrival]
    assert table["quality"].to_pylist() == [n % 5 for n in range(40)]
    assert json.loads(table.schema.metadata[b"cellwatt"])["cell"] == "weld-3"
    assert pq.read_table(tmp_path / "out" / "supply.meter.parquet")["device_time_ns"].null_count == 40


def test_frames_carry_quality_and_bound_of_each_channel(folder, tmp_path):
    called(command, folder, "--out", tmp_path / "out", "--frames")
    assert [p.name for p in (tmp_path / "out").iterdir()] == ["frames.parquet"]
    table = pq.read_table(tmp_path / "out" / "frames.parquet")
    truth = [frames_of(0, 10), frames_of(20, 10)]
    for i in range(3):
        name = f"arm.joint_{i + 1}.position"
        assert np.array_equal(table[name], np.concatenate([f.values[:, i] for f in truth]))
        assert np.array_equal(table[f"{name}.quality"], np.concatenate([f.quality[:, i] for f in truth]))
        assert np.array_equal(table[f"{name}.bound_ns"], np.concatenate([f.bound[:, i] for f in truth]))


def test_csv_has_the_same_digits_and_its_units_beside_it(folder, tmp_path):
    called(command, folder, "--out", tmp_path / "out", "--format", "csv", "--raw")
    names = sorted(p.name for p in (tmp_path / "out").iterdir())
    assert names == ["arm.rtde.csv", "arm.rtde.json", "supply.meter.csv", "supply.meter.json"]
    signals = load_signals(tmp_path / "out" / "arm.rtde.csv")
    assert np.array_equal(signals.columns["joint_3.position"], batch_of(0, 40).values[:, 2])
    about = json.loads((tmp_path / "out" / "arm.rtde.json").read_text())
    assert about["units"]["joint_3.position"] == "rad" and about["start_utc_ns"] == SESSION


def test_results_and_events_are_json_lines(folder, tmp_path):
    assert "results.jsonl: 5 rows" in called(command, folder / name_of(1), "--out", tmp_path / "out")
    lines = [json.loads(line) for line in (tmp_path / "out" / "results.jsonl").read_text().splitlines()]
    assert [line["type"] for line in lines] == ["interval", "task", "energy", "prediction", "alarm"]
    assert lines[4]["kind"] == "joint_fault" and lines[4]["evidence"] == {"power_W": 12.5}


def test_nothing_is_overwritten_unless_told(folder, tmp_path):
    called(command, folder, "--out", tmp_path / "out")
    with pytest.raises(RecordingError, match=r"arm\.rtde\.parquet already exists: choose another folder"):
        called(command, folder, "--out", tmp_path / "out")
    called(command, folder, "--out", tmp_path / "out", "--force")


@pytest.mark.parametrize("form", ["parquet", "csv"])
def test_units_asked_for_are_named_and_read_back_by_the_reader_of_tables(folder, tmp_path, form):
    out = tmp_path / "out"
    called(command, folder, "--out", out, "--format", form, "--raw", "--units", "deg")
    radians = batch_of(0, 35).values[:, 0]
    file = out / f"arm.rtde.{form}"
    name = "joint_1.position" if form == "parquet" else "joint_1.position [deg]"
    table = read_table(file)
    assert table.columns[name][:35] == pytest.approx(radians * 180 / np.pi, rel=1e-14)
    assert table.needed("position", 6)[:35, 0] == pytest.approx(radians, rel=1e-14)
    if form == "parquet":
        assert load_signals(file).columns["joint_1.position"][:35] == pytest.approx(radians, rel=1e-14)
        assert pq.read_schema(file).field(name).metadata == {b"unit": b"deg"}
    else:
        assert json.loads(file.with_suffix(".json").read_text())["units"][name] == "deg"
