"""A model file against the model it was made of: offline, live, and what a frame costs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt_plugins.models import read_metadata
from cellwatt_plugins.models.power.api import write
from cellwatt_plugins.models.power.fitting import Structure, fit
from cellwatt_plugins.models.power.moves import read_moves
from cellwatt_plugins.models.power.terms import EFFECTS
from cellwatt_plugins.models.power.training import estimate
from cellwatt_plugins.models.predict import predict_file
from tests.plugins.models.making import frames, layout, run, split, stage, undated
from tests.plugins.models.power.cases import six_axes_recorded, tuning_of

EVERYTHING = Structure(tuple(EFFECTS), ("iron loss", "eddy-current loss"), "joint", 0.1, network=True)
PLAIN = Structure((), ("loss of the inverters by current", "brakes held open while the arm moves"), "bus", 0.1)


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """The arm, and a short table with payload and temperatures."""
    folder = tmp_path_factory.mktemp("arm")
    described, table = six_axes_recorded(folder, 5, 4, (0.8, 1.5))
    rows = table.num_rows
    table = table.append_column("payload", pa.array(np.where(np.arange(rows) < rows // 2, 0.0, 1.5)))
    for i in range(6):
        table = table.append_column(f"temperature_{i + 1}", pa.array(25 + 5 * np.linspace(0, 1, rows) + i))
    pq.write_table(table, folder / "moves.parquet")
    return described, folder / "moves.parquet"


def made(arm, folder, structure, plain=False):
    described, table = arm
    moves = read_moves([table], described.description.names)
    if plain:
        moves = replace(moves, payload=None, temperature=None)
    fitted = fit(moves, described, tuning_of(moves), structure)
    metadata = write(folder / "model.onnx", fitted, moves, described)
    return fitted, moves, metadata


@pytest.mark.parametrize(("structure", "plain"), [(EVERYTHING, False), (PLAIN, True)], ids=["everything", "plain"])
def test_the_file_says_what_the_model_says(arm, tmp_path, structure, plain):
    described, table = arm
    fitted, moves, metadata = made(arm, tmp_path, structure, plain)
    predict_file(tmp_path / "model.onnx", table, tmp_path / "said.parquet")
    said = pq.read_table(tmp_path / "said.parquet")
    power, current = estimate(fitted, moves, described)
    assert np.abs(said["power"].to_numpy() - power).max() < 1e-6
    for i in range(6):
        assert np.abs(said[f"current_{i + 1}"].to_numpy() - current[:, i]).max() < 1e-6
    assert read_metadata(tmp_path / "model.onnx") == metadata
    assert (metadata.window, metadata.rate_hz, metadata.robot) == (11, 125.0, "arm")
    assert metadata.joints == described.description.names
    assert [i.channel for i in metadata.inputs[12:]] == (
        [] if plain else ["tool.payload", *(f"joint_{i}.temperature" for i in range(1, 7))]
    )


def test_the_same_moves_give_the_same_file(arm, tmp_path):
    for name in ("one", "other"):
        made(arm, tmp_path / name, PLAIN, plain=True)
    assert undated(tmp_path / "one" / "model.onnx") == undated(tmp_path / "other" / "model.onnx")


def test_live_it_says_the_same_as_offline(arm, tmp_path):
    _, moves, _ = made(arm, tmp_path, PLAIN, plain=True)
    first, end = moves.bounds()[1]
    units = {"position": "rad", "velocity": "rad/s"}
    grid = layout({f"arm.joint_{i}.{what}": unit for what, unit in units.items() for i in range(1, 7)}, 125.0)
    block = frames(np.concatenate([moves.q, moves.qd], axis=1)[first:end], grid)
    results = run(stage(tmp_path / "model.onnx", grid, robot="arm"), split(block, [1, 50, 51]))
    live = np.concatenate([result.outputs["power"] for result in results if hasattr(result, "outputs")])
    predict_file(tmp_path / "model.onnx", arm[1], tmp_path / "said.parquet")
    offline = pq.read_table(tmp_path / "said.parquet")["power"].to_numpy()[first:end]
    whole = np.isfinite(live)
    assert whole.sum() == len(block) - 10
    assert np.abs(live - offline[: len(live)])[whole].max() < 1e-6
