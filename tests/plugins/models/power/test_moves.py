"""Tables of moves as users bring them."""

from __future__ import annotations

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet as pq
import pytest

from cellwatt.errors import RecordingError
from cellwatt_plugins.models.power.moves import read_moves


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
    moves = read_moves([path], 2)
    assert (moves.count, len(moves), moves.joints, moves.bounds()) == (2, 40, 2, [(0, 20), (20, 40)])
    assert moves.step == pytest.approx(0.01)
    assert np.array_equal(moves.power, columns()["power"])
    assert moves.payload is None


def test_holes_and_missing_positions_end_a_move(tmp_path):
    table = columns(60)
    table["t"][30:] += 1.0
    table["q_1"][45] = np.nan
    moves = read_moves([written(tmp_path, table)], 2)
    assert moves.bounds() == [(0, 30), (30, 45), (45, 59)]


def test_an_uneven_clock_is_put_on_a_grid(tmp_path):
    table = columns(200)
    jitter = np.random.default_rng(0).uniform(-0.002, 0.002, 200)
    t = table["t"] + jitter
    uneven = {"t": t} | {f"q_{i}": np.sin(i * t) for i in (1, 2)} | {f"qd_{i}": i * np.cos(i * t) for i in (1, 2)}
    moves = read_moves([written(tmp_path, uneven | {"power": t})], 2)
    assert np.ptp(np.diff(moves.time)) < 1e-9
    assert np.abs(moves.q[:, 0] - np.sin(moves.time)).max() < 1e-4
    assert np.isnan(moves.current).all()


def test_currents_without_those_of_one_joint_are_none(tmp_path):
    table = columns() | {"current_2": np.full(len(columns()["t"]), np.nan)}
    assert np.isnan(read_moves([written(tmp_path, table)], 2).current).all()


@pytest.mark.parametrize(
    ("gone", "said"),
    [
        (["t"], "no column t, timestamp or time for the time"),
        (["q_2"], "no column q_2; there are: "),
        (["power", "current_1", "current_2"], "no column power, nor of current_1 …"),
    ],
)
def test_what_is_missing_is_said(tmp_path, gone, said):
    table = {name: values for name, values in columns().items() if name not in gone}
    with pytest.raises(RecordingError, match=said):
        read_moves([written(tmp_path, table)], 2)


def test_power_is_the_first_channel_that_holds_numbers(tmp_path):
    dead = columns() | {"power": np.full(40, np.nan), "bus.power": np.full(40, 7.0)}
    assert set(read_moves([written(tmp_path, dead)], 2).power) == {7.0}
    none = dead | {name: np.full(40, np.nan) for name in ("bus.power", "current_1", "current_2")}
    with pytest.raises(RecordingError, match="that holds numbers; there are: "):
        read_moves([written(tmp_path, none)], 2)
