"""Metadata written into a file and read back."""

from __future__ import annotations

import hashlib
import struct
import sys
from datetime import UTC, datetime
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import onnx
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from cellwatt import CellwattError, ModelError
from cellwatt_plugins.models import Input, Training, describe, read_metadata
from cellwatt_plugins.models.describe import write_model
from cellwatt_plugins.onnx_file import OnnxFile
from tests.plugins.models.making import Mlp, metadata, stage


def test_described_file_is_taken_and_says_what_was_written(tmp_path):
    path = Mlp.random(1).save(tmp_path / "m.onnx", None)
    describe(path, metadata())
    assert read_metadata(path) == metadata()
    describe(str(path), metadata(name="second"))
    assert stage(path).metadata.name == "second"
    onnx.checker.check_model(path)
    assert [p.name for p in tmp_path.iterdir()] == ["m.onnx"]


@settings(max_examples=50, deadline=None)
@given(at=st.floats(0, 1, exclude_max=True))
def test_a_file_that_was_cut_off_anywhere_is_refused(tmp_path_factory, at):
    path = Mlp.random(1).save(tmp_path_factory.mktemp("cut") / "m.onnx", None)
    describe(path, metadata())
    content = path.read_bytes()
    path.write_bytes(content[: int(at * len(content))])
    for opened in (stage, read_metadata):
        with pytest.raises(ModelError, match=r"the model .* is refused: "):
            opened(path)


def with_weights_beside(folder: Path, seed: int) -> Path:
    """As PyTorch's exporter writes it: the weights in ``m.onnx.data``."""
    path = Mlp.random(seed).save(folder / "m.onnx", None)
    model = onnx.load(path)
    onnx.save_model(model, path, save_as_external_data=True, location="m.onnx.data", size_threshold=100)
    return path


def test_weights_beside_the_file_are_packed_into_it(tmp_path):
    path = with_weights_beside(tmp_path, 1)
    rows = np.random.default_rng(1).normal(size=(5, 3)).astype(np.float32)
    before = OnnxFile(path).run(rows)
    describe(path, metadata())
    for other in (b"", b"\0" * 12, None):
        (tmp_path / "m.onnx.data").write_bytes(other) if other is not None else (tmp_path / "m.onnx.data").unlink()
        np.testing.assert_array_equal(OnnxFile(path).run(rows), before)
        assert stage(path).metadata == metadata()


def test_a_file_that_does_not_agree_stays_as_it_was(tmp_path):
    path = Mlp.random(1, outputs=3).save(tmp_path / "m.onnx", None)
    before = path.read_bytes()
    with pytest.raises(ModelError, match="expected \\[2, 2\\] for the metadata's outputs power, heat"):
        describe(path, metadata())
    assert path.read_bytes() == before


def test_a_file_that_cannot_be_written_is_told(tmp_path, monkeypatch):
    path = Mlp.random(1).save(tmp_path / "m.onnx", None)
    monkeypatch.setattr(Path, "replace", Mock(side_effect=OSError(28, "No space left on device")))
    with pytest.raises(ModelError, match="cannot be written: no space left"):
        describe(path, metadata())
    assert [p.name for p in tmp_path.iterdir()] == ["m.onnx"]


def test_a_folder_that_is_a_file_is_told(tmp_path):
    content = Mlp.random(1).save(tmp_path / "m.onnx", None).read_bytes()
    with pytest.raises(ModelError, match="cannot be written: not a directory"):
        write_model(tmp_path / "m.onnx" / "models" / "m.onnx", content, metadata())


def test_without_onnx_the_package_is_named(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "onnx", None)
    with pytest.raises(CellwattError, match="pip install onnx"):
        describe(tmp_path / "m.onnx", metadata())


def test_training_of_a_table():
    when = datetime(2026, 1, 2, tzinfo=UTC)
    made = Training.of([[1, 10], [3, float("nan")], [2, -5]], when)
    assert made.range == ((1.0, 3.0), (-5.0, 10.0))
    assert (made.rows, made.created) == (3, when)
    assert Training.of(np.array([[1.5]])).data == hashlib.sha256(struct.pack("<d", 1.5)).hexdigest()


def test_contradictions_are_refused_when_made():
    with pytest.raises(ValidationError, match="expected one of"):
        Input("joint_1.position", "deg")
    with pytest.raises(ValidationError, match="4 entries for 3 inputs"):
        metadata(training=Training.of(np.ones((2, 4))))
    with pytest.raises(ValidationError, match="a delay of 5 frames is not within a window of 5"):
        metadata(window=5, delay=5)
