"""What the page on models tells to write works as it stands there."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from cellwatt.config import load
from cellwatt.runtime.assemble import prepare
from cellwatt_plugins.models import ModelStage, read_metadata
from tests.plugins.models.making import Mlp

PAGE = (Path(__file__).resolve().parents[3] / "docs" / "models.md").read_text()


def block(language: str) -> str:
    (found,) = re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    return found


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """A folder with an exported recording and a model, as the page assumes."""
    monkeypatch.chdir(tmp_path)
    for folder in ("export", "models"):
        Path(folder).mkdir()
    rng = np.random.default_rng(1)
    names = [f"arm.joint_{j}.{q}" for j in range(1, 7) for q in ("position", "velocity", "torque")]
    pq.write_table(pa.table({n: rng.uniform(-3, 3, 50) for n in names}), "export/frames.parquet")
    Mlp.random(1, inputs=12, outputs=1).save(Path("models/ur10e-power.onnx"), None)
    return tmp_path


def test_described_as_on_the_page_the_model_fits_the_cell_of_the_page(desk):
    exec(compile(block("python"), "models.md", "exec"), {})
    told = read_metadata("models/ur10e-power.onnx")
    assert (len(told.inputs), told.training.rows) == (12, 50)
    Path("cell.yaml").write_text(block("yaml"))
    stages = prepare(load(Path("cell.yaml"), {})).stages
    assert isinstance(stages["power"], ModelStage)


def test_the_page_has_the_json_of_the_format():
    keys = set(re.findall(r'"(\w+)":', PAGE[PAGE.index('{"version": 1') :]))
    training = {"data", "range", "created", "rows"}
    file = {"version", "name", "robot", "inputs", "outputs", "rate_hz", "window", "training"}
    assert keys == file | {"channel", "unit"} | training
