"""The one reader of tables: its names, units and files, and what it says of files that are none."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt.errors import RecordingError
from cellwatt.tables import Table, read_table, write_table

ONE = np.ones(3)


def table(**columns: object) -> Table:
    return Table(Path("a.csv"), {name: np.asarray(values, np.float64) for name, values in columns.items()})


@pytest.mark.parametrize(
    ("names", "quantity"),
    [
        (("q_1", "q_2"), "position"),
        (("actual_q_0", "actual_q_1"), "position"),
        (("arm.joint_1.position", "arm.joint_2.position"), "position"),
        (("joint_1_velocity", "joint_2_velocity"), "velocity"),
        (("actual_current_as_torque_0", "actual_current_as_torque_1"), "torque"),
        (("arm.joint_1.target_acceleration", "arm.joint_2.target_acceleration"), "target_acceleration"),
        (("q_from_1", "q_from_2"), "came_from"),
    ],
)
def test_names_of_a_joints_quantity(names: tuple[str, str], quantity: str) -> None:
    found = table(**{names[1]: 2 * ONE, names[0]: ONE, "move": ONE})
    np.testing.assert_array_equal(found.joints(quantity), np.column_stack([ONE, 2 * ONE]))
    np.testing.assert_array_equal(found.channel(f"joint_2.{quantity}"), 2 * ONE)
    assert found.channel(f"joint_3.{quantity}") is None


def test_names_of_the_supplys_power() -> None:
    for name in ("Power", "supply.power", "meter.supply.power", "supply_power", "power [W]"):
        assert table(**{name: ONE}).whole("supply.power") is not None, name
        assert table(**{name: ONE}).channel("supply.power") is not None, name


@pytest.mark.parametrize(
    ("name", "quantity", "value"),
    [
        ("q_1 [deg]", "position", np.pi / 180),
        ("q_1 (Degrees)", "position", np.pi / 180),
        ("qd_1 [degree/s]", "velocity", np.pi / 180),
        ("tau_1 [N.m]", "torque", 1.0),
        ("q_1 [mm]", "position", 1e-3),
        ("qdd_1 [mm/s²]", "acceleration", 1e-3),
        ("velocity_1_deg_s", "velocity", np.pi / 180),
        ("torque_percent_1", "torque_ratio", 0.01),
        ("temperature_1 [K]", "temperature", -272.15),
    ],
)
def test_units_of_a_joints_quantity(name: str, quantity: str, value: float) -> None:
    found = table(**{name: [1.0]}).joints(quantity)
    assert found is not None
    assert found[0, 0] == pytest.approx(value)


@pytest.mark.parametrize(
    ("unit", "along"), [("mm", True), ("Millimeters", True), ("°", False), ("degrees", False), ("W", None), ("", None)]
)
def test_a_linear_axis_is_known_by_its_unit_however_it_is_spelled(unit: str, along: bool | None) -> None:
    name = f"q_1 [{unit}]"
    assert table(**{name: ONE}).along(name) is along


def test_units_of_time_power_and_payload() -> None:
    for name, seconds in (("time [s]", 1.0), ("time_ms", 1e-3), ("timestamp (us)", 1e-6), ("utc_ns", 1e-9)):
        found = table(**{name: [0.0, 4e9], "q_1": [0, 1], "power_kW": [0.25] * 2, "payload [g]": [500.0] * 2})
        assert found.rising_time() == pytest.approx([0.0, 4e9 * seconds])
        assert found.names == ("q_1", "power_kW", "payload [g]")
        assert found.whole("supply.power") == pytest.approx([250.0] * 2)
        assert found.whole("tool.payload") == pytest.approx([0.5] * 2)


def test_megawatts_are_no_milliwatts() -> None:
    for unit in ("mW", "milliwatt", "MILLIWATTS"):
        assert table(**{f"power [{unit}]": [2.0]}).whole("supply.power") == pytest.approx([2e-3]), unit
    for unit in ("MW", "MWatt"):
        with pytest.raises(RecordingError, match=f"unknown unit '{unit}' .expected W, mW, kW"):
            table(**{f"power [{unit}]": [2.0]}).whole("supply.power")
    assert table(power_MW=[2.0]).whole("supply.power") is None


def test_a_unit_beside_the_name_counts_where_the_name_has_none(tmp_path: Path) -> None:
    types = {"t": pa.float64(), "q_1": pa.float64(), "note": pa.string()}
    units = {"t": "s", "q_1": "deg", "note": "mm"}
    schema = pa.schema([pa.field(name, types[name], metadata={"unit": unit}) for name, unit in units.items()])
    pq.write_table(pa.table([[0.0, 1.0], [90.0, 180.0], ["wet", "dry"]], schema=schema), tmp_path / "a.parquet")
    found = read_table(tmp_path / "a.parquet")
    np.testing.assert_allclose(found.joints("position"), [[np.pi / 2], [np.pi]])
    assert "wet" in found.unfit["note"], "a text stays what it is"
    assert found.units["note"] == "mm"


def test_of_several_names_the_preferred_one_counts() -> None:
    found = table(actual_q_0=ONE, q_1=3 * ONE, **{"arm.joint_1.position": 2 * ONE}, timestamp=ONE, t=5 * ONE)
    np.testing.assert_array_equal(found.joints("position"), 3 * ONE[:, None])
    np.testing.assert_array_equal(found.time, 5 * ONE)


def test_a_channel_of_no_joint_is_found_with_its_source() -> None:
    found = table(**{"board.fan.speed": ONE, "move": 2 * ONE})
    np.testing.assert_array_equal(found.channel("fan.speed"), ONE)
    np.testing.assert_array_equal(found.channel("move"), 2 * ONE)
    assert found.channel("fan") is None


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"left.joint_1.position": ONE, "right.joint_1.position": ONE}, "several sources give position (left.joint_1."),
        ({"q_1": ONE, "q1": ONE}, "two columns are called 'q_1' and 'q1': keep one"),
        ({"q_1": ONE, "q_4": ONE}, "no column q_2, q_3; there are q_1, q_4"),
        (
            {"q_1 [grad]": ONE},  # German for degree
            "column q_1 [grad]: unknown unit 'grad' (expected rad, mrad, deg, m, mm)",
        ),
        ({"qq_1": ONE, "t": ONE}, "no column q_1; did you mean 'qq_1'?; there are: qq_1"),
    ],
)
def test_what_is_wrong_with_the_columns_is_said(columns: dict[str, object], message: str) -> None:
    with pytest.raises(RecordingError) as caught:
        table(**columns).needed("position", 1)
    assert str(caught.value).startswith(f"a.csv: {message}")


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match=r"a\.csv: cannot be read: No such file"):
        read_table(tmp_path / "a.csv")


def test_whole_numbers_may_turn_into_fractions_late_in_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    count = 200_000
    path.write_text("t,power\n" + "".join(f"{i},90\n" for i in range(count)) + f"{count},90.5\n")
    assert path.stat().st_size > 1 << 20
    power = read_table(path).whole("supply.power")
    assert power is not None
    assert power[-1] == 90.5


@pytest.mark.parametrize("name", ["out/a.csv", "out/a.parquet"])
def test_what_is_written_is_read(tmp_path: Path, name: str) -> None:
    columns = {"t": np.array([0.0, 0.1]), "move": np.array([1, 2]), "power": np.array([90.0, np.pi])}
    write_table(tmp_path / name, columns)
    np.testing.assert_equal(read_table(tmp_path / name).columns, columns)
    (tmp_path / "file").touch()
    with pytest.raises(RecordingError, match="cannot be written"):
        write_table(tmp_path / "file" / "a.csv", columns)


def test_angles_of_a_motion_are_counted_on_and_those_of_poses_are_not() -> None:
    angles = np.mod(0.3 * np.arange(60.0), 2 * np.pi)
    for time, jumps in ((0.1 * np.arange(60), 2), (5.0 * np.arange(60), 0)):
        found = table(t=time, q_1=angles)
        assert found.wraps("q_1") == jumps
        np.testing.assert_allclose(np.diff(found.joints("position")[:, 0]).min(), 0.3 if jumps else 0.3 - 2 * np.pi)
    assert table(q_1=angles).wraps("q_1") == 0


def test_a_small_file_that_unpacks_to_gigabytes_is_refused(tmp_path):
    """A text of 100 kB that each of 100,000 rows names, and columns without end."""
    texts = pa.DictionaryArray.from_arrays(pa.array(np.zeros(100_000, np.int32)), pa.array(["x" * 100_000]))
    for column in (texts, pa.StructArray.from_arrays([texts], ["text"])):
        columns = {"t": np.arange(100_000.0), "note": column}
        pq.write_table(pa.table(columns), tmp_path / "texts.parquet", store_schema=False)
        assert (tmp_path / "texts.parquet").stat().st_size < 1_000_000
        with pytest.raises(RecordingError, match="has more than 1,000,000,000 bytes of text"):
            read_table(tmp_path / "texts.parquet")
    (tmp_path / "wide.csv").write_text(",".join(f"c{i}" for i in range(5001)) + "\n" + "1," * 5000 + "1\n")
    with pytest.raises(RecordingError, match="has 5,001 columns; 5,000 are the most"):
        read_table(tmp_path / "wide.csv")


def test_columns_of_numbers_in_other_types_and_in_lists(tmp_path: Path) -> None:
    """As pandas, Spark and loggers of robots write them."""
    columns = {
        "t": pa.array([0, 20_000], pa.duration("us")),
        "power": pa.array(["1.5", "2.5"]).cast(pa.decimal128(5, 1)),
        "position": [[1.0, 2.0], [3.0, None]],
        "qd": pa.array([[5, 6], [7, 8]], pa.list_(pa.int32(), 2)),
        "log": [{"fan": 1.0, "notes": [1.0]}, {"fan": 2.0, "notes": []}],
    }
    pq.write_table(pa.table(columns), tmp_path / "a.parquet")
    found = read_table(tmp_path / "a.parquet")
    assert found.time.tolist() == [0.0, 0.02]
    assert found.whole("supply.power").tolist() == [1.5, 2.5]
    np.testing.assert_array_equal(found.joints("position"), [[1.0, 2.0], [3.0, np.nan]])
    np.testing.assert_array_equal(found.joints("velocity"), [[5.0, 6.0], [7.0, 8.0]])
    assert found.columns["log.fan"].tolist() == [1.0, 2.0]
    assert found.unfit["log.notes"].startswith("holds lists of text, or of different lengths, first '[1.0]' in row 1")


def test_a_column_that_is_there_twice_spares_the_others(tmp_path: Path) -> None:
    pq.write_table(pa.Table.from_arrays([pa.array([0.0, 1.0])] * 3, ["t", "power", "power"]), tmp_path / "a.parquet")
    assert read_table(tmp_path / "a.parquet").time.tolist() == [0.0, 1.0]
