"""An ONNX file opened with onnxruntime, and checked against its metadata."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cellwatt_plugins.models.metadata import Metadata, metadata_of
from cellwatt_plugins.onnx_file import DTYPES, OnnxFile

APART = 1e-3
"""Largest relative difference, from rounding, of the outputs of a frame alone and among others."""


class Network(OnnxFile):
    """A session that agrees with its metadata; if left out, the file's metadata.

    Inputs of ``run`` are (n, inputs), or (n, window, inputs) where the window is above 1.

    Raises ``ModelError`` if its tensors differ from the metadata in shape or type, or if its outputs for a frame
    depend on the other frames of the call, or differ from call to call: a replay would then differ from the
    published predictions.
    """

    def __init__(self, model: Path | bytes, metadata: Metadata | None = None) -> None:
        super().__init__(model)
        self.metadata = metadata or metadata_of(self)
        if len(self.inputs) != 1 or len(self.outputs) != 1:
            found = f"{len(self.inputs)} input and {len(self.outputs)} output tensors"
            raise self.refused(f"it has {found}, expected one of each")
        for tensor in self.inputs + self.outputs:
            if tensor.type not in DTYPES:
                raise self.refused(f"its tensor {tensor.name!r} is {tensor.type}, expected {' or '.join(DTYPES)}")
        self._check_input(self.inputs[0].shape)
        self._try()

    def _check_input(self, shape: list[int | str | None]) -> None:
        meta = self.metadata
        count = len(meta.inputs)
        expected = [count] if meta.window == 1 else [meta.window, count]
        windowed = "" if meta.window == 1 else f", window {meta.window}"
        wanted = f"expected [N, {', '.join(map(str, expected))}] for the metadata's {count} inputs{windowed}"
        found = f"its input tensor {self.inputs[0].name!r} has the shape [{', '.join(str(d) for d in shape)}]"
        sizes = zip(shape[1:], expected, strict=False)
        if len(shape) != 1 + len(expected) or any(isinstance(d, int) and d != size for d, size in sizes):
            raise self.refused(f"{found}, {wanted}")
        if isinstance(shape[0], int):
            raise self.refused(f"{found}, {wanted}: export it with a dynamic first axis")

    def _try(self) -> None:
        """Runs the corners of the training range, together and alone."""
        meta = self.metadata
        corners = self.cast(np.array(meta.training.range).T)
        if meta.window > 1:
            corners = np.repeat(corners[:, np.newaxis], meta.window, axis=1)
        together = self.run(corners)
        expected = (2, len(meta.outputs))
        if together.shape != expected:
            names = ", ".join(o.name for o in meta.outputs)
            raise self.refused(
                f"its output tensor {self.outputs[0].name!r} has the shape {list(together.shape)} for 2 frames, "
                f"expected {list(expected)} for the metadata's outputs {names}"
            )
        alone = np.concatenate([self.run(corners[:1]), self.run(corners[1:])])
        scale = np.max(np.abs(together), initial=0.0, where=np.isfinite(together))
        if not np.allclose(alone, together, rtol=APART, atol=APART * scale, equal_nan=True):
            raise self.refused(
                f"one frame alone gives {alone.tolist()}, among others {together.tolist()}, expected the same: "
                "export it for inference, with dropout and batch statistics off"
            )
