"""ONNX model files, opened for one thread on the CPU, with JSON metadata that describes each model."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from cellwatt.errors import ConfigError, ModelError, why
from cellwatt.files import check_file

T = TypeVar("T")
Array = NDArray[np.floating[Any]]
"""Numbers in the precision of a model."""

DTYPES: dict[str, type[np.floating[Any]]] = {"tensor(float)": np.float32, "tensor(double)": np.float64}

_PREFIX = re.compile(r"^\[ONNXRuntimeError\] : \d+ : \w+ : (Load model from .*? failed: ?)?")


class Tensor(NamedTuple):
    """An input or output of a graph."""

    name: str
    type: str
    shape: list[int | str | None]


def refused(model: PathLike[str] | str | None, reason: str) -> ModelError:
    """The error, in one line, that a model is not run, with its file if there is one and the reason."""
    return ModelError(f"the model {'' if model is None else f'{model} '}is refused: {' '.join(reason.split())}")


def decoded(text: str, kind: type[T], model: PathLike[str] | None) -> T:
    """Metadata of a model from its JSON text. Raises ``ModelError`` if that is no JSON or not of this kind."""
    try:
        return TypeAdapter(kind).validate_json(text, strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise refused(model, f"its metadata is wrong: {where} {first['msg'].removeprefix('Value error, ')}") from error


class OnnxFile:
    """A model file, or its bytes, in onnxruntime.

    Raises ``ConfigError`` if onnxruntime is not installed, ``ModelError`` if it cannot load the model.
    """

    def __init__(self, model: Path | bytes) -> None:
        self.path = model if isinstance(model, Path) else None
        # Before the import, which else writes a device ID into the home folder, and reports to its maker.
        os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")
        try:
            import onnxruntime
        except ImportError as error:
            raise ConfigError(
                f"running the model {self.path or ''} needs onnxruntime ({error}): install it with "
                "pip install 'cellwatt[model]'"
            ) from error
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        options.log_severity_level = 4  # errors are raised, with a message of one line
        source = model if isinstance(model, bytes) else str(model)
        cpu = ["CPUExecutionProvider"]
        with self._mapped("onnxruntime cannot load it as ONNX"):
            if self.path is not None:
                check_file(self.path)
            # onnxruntime's fallback to other providers prints errors.
            self._session = onnxruntime.InferenceSession(source, options, providers=cpu, enable_fallback=0)
        with self._mapped("onnxruntime cannot read its metadata"):
            self.properties: dict[str, str] = dict(self._session.get_modelmeta().custom_metadata_map)
        with self._mapped("onnxruntime cannot read its tensors"):
            self.inputs = [Tensor(t.name, t.type, list(t.shape)) for t in self._session.get_inputs()]
            self.outputs = [Tensor(t.name, t.type, list(t.shape)) for t in self._session.get_outputs()]

    def refused(self, reason: str) -> ModelError:
        """See ``refused``."""
        return refused(self.path, reason)

    def entry(self, key: str, kind: type[T]) -> T:
        """Metadata under a key as ``kind``. Raises ``ModelError`` if it is missing, no JSON or not of this kind."""
        if key not in self.properties:
            there = ", ".join(map(repr, self.properties)) or "none"
            raise self.refused(f"it has no metadata {key!r}, found {there}")
        return decoded(self.properties[key], kind, self.path)

    def cast(self, values: NDArray[Any]) -> Array:
        """Values in the precision of the model; those beyond float32 become infinite."""
        with np.errstate(over="ignore"):
            return values.astype(DTYPES.get(self.inputs[0].type, np.float64))

    def run(self, values: NDArray[Any]) -> NDArray[np.float64]:
        """First output (N, …) for the first input (N, …). Raises ``ModelError`` if the model fails on it."""
        try:
            given = self._session.run([self.outputs[0].name], {self.inputs[0].name: values})[0]
        except Exception as error:  # as in _mapped, without its cost for every frame
            raise self.refused(f"it fails on inputs of shape {list(values.shape)}: {_reason(error)}") from error
        return np.asarray(given, dtype=np.float64)

    @contextmanager
    def _mapped(self, what: str) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise self.refused(f"it cannot be read: {why(error).lower()}") from error
        except Exception as error:  # onnxruntime's errors share no other root
            raise self.refused(f"{what}: {_reason(error)}") from error


def _reason(error: Exception) -> str:
    # Python 3.11.2 has no text for some errors of onnxruntime.
    return _PREFIX.sub("", " ".join(str(error).split()))[:300] or type(error).__name__
