"""An ONNX file opened with onnxruntime, and held against its metadata."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import ConfigError
from cellwatt.files import COMPUTED, read_bytes
from cellwatt_plugins.models.metadata import KEY, Metadata, decode, refused
from cellwatt_plugins.models.seal import broken

if TYPE_CHECKING:
    from onnxruntime import InferenceSession

Array = NDArray[np.floating[Any]]
"""Numbers in the precision of the model."""

DTYPES: dict[str, type[np.floating[Any]]] = {"tensor(float)": np.float32, "tensor(double)": np.float64}
APART = 1e-3
"""Outputs of one frame alone and among others that differ by more, relative to the largest, are not rounding."""

_PREFIX = re.compile(r"^\[ONNXRuntimeError\] : \d+ : \w+ : (Load model from .*? failed: ?)?")


def check_intact(path: Path) -> None:
    """Raises ``ModelError`` where a file cannot be read, or has changed since ``describe`` wrote it."""
    try:
        damaged = broken(read_bytes(path, COMPUTED))
    except OSError as error:
        raise refused(path, f"it cannot be read: {(error.strerror or str(error)).lower()}") from error
    if damaged:
        raise refused(path, "it is not as describe() left it: copy it again, or describe it anew if that was meant")


def open_session(path: Path) -> InferenceSession:
    """Opens an ONNX file for one thread on the CPU.

    Raises ``ConfigError`` where onnxruntime is not installed, ``ModelError`` where it cannot load the file.
    """
    try:
        import onnxruntime
    except ImportError as error:
        raise ConfigError(
            f"running the model {path} needs onnxruntime ({error}): install it with pip install 'cellwatt[model]'"
        ) from error
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    options.inter_op_num_threads = 1
    options.log_severity_level = 4  # what goes wrong is raised, and told in one line
    with _mapped(path, "onnxruntime cannot load it as ONNX"):
        # Its fallback to other providers prints what goes wrong.
        return onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"], enable_fallback=0)


def metadata_of(session: InferenceSession, path: Path) -> Metadata:
    """The metadata in an open file. Raises ``ModelError`` where there is none, or it is wrong."""
    with _mapped(path, "onnxruntime cannot read its metadata"):
        properties = session.get_modelmeta().custom_metadata_map
    if KEY not in properties:
        there = ", ".join(map(repr, properties)) or "none"
        raise refused(
            path,
            f"it has no metadata: expected the key {KEY!r}, found {there}; "
            "cellwatt_plugins.models.describe() writes it into the file",
        )
    return decode(properties[KEY], path)


class Network:
    """A session that agrees with its metadata.

    Raises ``ModelError`` where its tensors have other shapes or types than the metadata says, or where it does not
    give the same outputs for a frame each time and whatever other frames are in the call: a replay would then
    differ from what was published.
    """

    def __init__(self, session: InferenceSession, metadata: Metadata, path: Path) -> None:
        self.metadata = metadata
        self.path = path
        self._session = session
        with _mapped(path, "onnxruntime cannot read its tensors"):
            inputs = [(t.name, t.type, list(t.shape)) for t in session.get_inputs()]
            outputs = [(t.name, t.type, list(t.shape)) for t in session.get_outputs()]
        if len(inputs) != 1 or len(outputs) != 1:
            raise refused(path, f"it has {len(inputs)} input and {len(outputs)} output tensors, expected one of each")
        for name, kind, _ in inputs + outputs:
            if kind not in DTYPES:
                raise refused(path, f"its tensor {name!r} is {kind}, expected {' or '.join(DTYPES)}")
        self._input, kind, shape = inputs[0]
        self._outputs = [outputs[0][0]]
        self._dtype = DTYPES[kind]
        self._check_input(shape)
        self._try()

    def cast(self, values: NDArray[np.float64]) -> Array:
        """Values in the precision of the model; those beyond float32 become infinite."""
        with np.errstate(over="ignore"):
            return values.astype(self._dtype)

    def run(self, values: Array) -> NDArray[np.float64]:
        """Outputs (n, outputs) for inputs (n, inputs), or (n, window, inputs) where the window is above 1.

        Raises ``ModelError`` where the model fails on them.
        """
        try:
            given = self._session.run(self._outputs, {self._input: values})[0]
        except Exception as error:  # as in _mapped, without its cost for every frame
            raise refused(self.path, f"it fails on inputs of shape {list(values.shape)}: {_reason(error)}") from error
        return np.asarray(given, dtype=np.float64)

    def _check_input(self, shape: list[int | str | None]) -> None:
        meta = self.metadata
        count = len(meta.inputs)
        expected = [count] if meta.window == 1 else [meta.window, count]
        windowed = "" if meta.window == 1 else f", window {meta.window}"
        wanted = f"expected [N, {', '.join(map(str, expected))}] for the metadata's {count} inputs{windowed}"
        found = f"its input tensor {self._input!r} has the shape [{', '.join(str(d) for d in shape)}]"
        sizes = zip(shape[1:], expected, strict=False)
        if len(shape) != 1 + len(expected) or any(isinstance(d, int) and d != size for d, size in sizes):
            raise refused(self.path, f"{found}, {wanted}")
        if isinstance(shape[0], int):
            raise refused(self.path, f"{found}, {wanted}: export it with a dynamic first axis")

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
            raise refused(
                self.path,
                f"its output tensor {self._outputs[0]!r} has the shape {list(together.shape)} for 2 frames, "
                f"expected {list(expected)} for the metadata's outputs {names}",
            )
        alone = np.concatenate([self.run(corners[:1]), self.run(corners[1:])])
        scale = np.max(np.abs(together), initial=0.0, where=np.isfinite(together))
        if not np.allclose(alone, together, rtol=APART, atol=APART * scale, equal_nan=True):
            raise refused(
                self.path,
                f"one frame alone gives {alone.tolist()}, among others {together.tolist()}, expected the same: "
                "export it for inference, with dropout and batch statistics off",
            )


def open_network(path: Path) -> Network:
    """Opens a model file with metadata. Raises ``ConfigError`` and ``ModelError`` as its parts do."""
    check_intact(path)
    session = open_session(path)
    return Network(session, metadata_of(session, path), path)


@contextmanager
def _mapped(path: Path, what: str) -> Iterator[None]:
    try:
        yield
    except Exception as error:  # onnxruntime's errors share no other root
        raise refused(path, f"{what}: {_reason(error)}") from error


def _reason(error: Exception) -> str:
    return _PREFIX.sub("", " ".join(str(error).split()))[:300]
