"""Tables of moves as users bring them."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from cellwatt.errors import RecordingError
from cellwatt_plugins.models.power.moves import read_moves

JOINTS = ("joint_1", "joint_2")


def columns(rows=40, step=0.01):
    t = np.arange(rows) * step
    out = {"t": t}
    for i in (1, 2):
        out |= {f"q_{i}": np.sin(i * t), f"qd_{i}": i * np.cos(i * t), f"current_{i}": i + t}
    return out | {"power": 100 + t}


def written(tmp_path, table, name="train.parquet"):
    path = tmp_path / name
    pq.write_table(pa.table(table), path)
    return path


def test_a_table_with_several_moves(tmp_path):
    path = written(tmp_path, columns() | {"move": np.repeat([7, 9], 20)})
    moves = read_moves([path], JOINTS)
    assert (moves.count, len(moves), moves.joints, moves.bounds()) == (2, 40, 2, [(0, 20), (20, 40)])
    assert moves.step == pytest.approx(0.01)
    assert np.array_equal(moves.power, columns()["power"])
    assert moves.payload is None


def test_holes_and_missing_positions_end_a_move_unless_they_are_short(tmp_path, caplog):
    table = columns(100)
    table["t"][30:] += 1.0
    table["q_1"][[*range(45, 49), 60, 93]] = np.nan
    moves = read_moves([written(tmp_path, {name: np.delete(column, 75) for name, column in table.items()})], JOINTS)
    assert moves.bounds() == [(0, 30), (30, 45), (45, 96)]
    last = slice(*moves.bounds()[-1])
    assert np.abs(np.diff(moves.time[last]) - 0.01).max() < 1e-9
    assert np.abs(moves.q[last, 0] - np.sin(moves.time[last] - 1.0)).max() < 1e-4
    assert "6 of 99 rows are left out" in caplog.text


def test_moves_at_several_rates_are_put_on_the_grid_of_most_rows(tmp_path):
    files = [written(tmp_path, columns(*shape), f"{i}.parquet") for i, shape in enumerate([(200, 0.01), (50, 0.02)])]
    assert read_moves(files, JOINTS).step == pytest.approx(0.01)


def test_a_payload_that_one_file_lacks_is_not_used_and_said(tmp_path, caplog):
    files = [written(tmp_path, columns() | {"payload": np.full(40, 2.0)}, "told.parquet"), written(tmp_path, columns())]
    assert read_moves(files, JOINTS).payload is None
    assert f"{files[1]}: no payload: that of the other files is not used" in caplog.text


def test_an_uneven_clock_is_put_on_a_grid(tmp_path):
    table = columns(200)
    jitter = np.random.default_rng(0).uniform(-0.002, 0.002, 200)
    t = table["t"] + jitter
    uneven = {"t": t} | {f"q_{i}": np.sin(i * t) for i in (1, 2)} | {f"qd_{i}": i * np.cos(i * t) for i in (1, 2)}
    moves = read_moves([written(tmp_path, uneven | {"power": t})], JOINTS)
    assert np.ptp(np.diff(moves.time)) < 1e-9
    assert np.abs(moves.q[:, 0] - np.sin(moves.time)).max() < 1e-4
    assert np.isnan(moves.current).all()


@pytest.mark.parametrize("dead", [np.nan, 0.3])
def test_a_current_without_numbers_or_of_one_value_is_not_used(tmp_path, caplog, dead):
    current = read_moves([written(tmp_path, columns() | {"current_2": np.full(40, dead)})], JOINTS).current
    assert np.isfinite(current).all(axis=0).tolist() == [True, False]
    assert "current_2: no number, or always the same: not used" in caplog.text


def test_a_blank_of_a_slow_channel_repeats_the_value_before(tmp_path):
    slow = np.where(np.arange(40) % 15 == 4, np.arange(40.0), np.nan)
    table = columns() | {"payload": slow, "temperature_1": slow, "temperature_2": slow + 1}
    moves = read_moves([written(tmp_path, table)], JOINTS)
    held = np.repeat([4.0, 19.0, 34.0], [19, 15, 6])
    assert np.array_equal(moves.payload, held)
    assert np.array_equal(moves.temperature, np.column_stack([held, held + 1]))
    blank = columns() | dict.fromkeys(("payload", "temperature_1", "temperature_2"), np.full(40, np.nan))
    moves = read_moves([written(tmp_path, blank)], JOINTS)
    assert (moves.payload, moves.temperature) == (None, None)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"t": None}, "no column t, timestamp or time for the time"),
        ({"t": np.round(np.arange(40) * 0.008, 2)}, r"column t does not rise from 0.02 to 0.02 s in row 4"),
        ({"q_2": None}, "no column q_2; there are: "),
        ({"move": np.repeat(["pick", "place"], 20)}, "column move holds text, first 'pick'"),
        (dict.fromkeys(("power", "current_1", "current_2")), "no column power, nor of current_1 …"),
        (
            dict.fromkeys(("power", "bus.power", "current_1", "current_2"), np.full(40, np.nan)),
            "that holds numbers which vary; there are: ",
        ),
    ],
)
def test_what_is_missing_is_said(tmp_path, change, words):
    table = {name: values for name, values in (columns() | change).items() if values is not None}
    with pytest.raises(RecordingError, match=words):
        read_moves([written(tmp_path, table)], JOINTS)


@pytest.mark.parametrize("dead", [np.nan, 231.0])
def test_power_is_the_first_channel_that_varies(tmp_path, caplog, dead):
    bus = np.arange(40.0)
    table = columns() | {"power": np.full(40, dead)}
    assert np.array_equal(read_moves([written(tmp_path, table | {"bus.power": bus})], JOINTS).power, bus)
    assert not caplog.text
    assert np.isnan(read_moves([written(tmp_path, table)], JOINTS).power).all()
    assert "power: no number, or always the same: not used" in caplog.text
