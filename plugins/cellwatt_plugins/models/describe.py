"""Writes metadata into an exported ONNX file, and reads it back."""

from __future__ import annotations

from contextlib import suppress
from os import PathLike
from pathlib import Path
from typing import Any

from cellwatt.errors import CellwattError, why
from cellwatt.files import replace_bytes
from cellwatt_plugins.models.metadata import KEY, Metadata, encode, metadata_of
from cellwatt_plugins.models.network import Network
from cellwatt_plugins.onnx_file import OnnxFile, refused


def describe(path: str | PathLike[str], metadata: Metadata) -> None:
    """Writes metadata into an ONNX file; the file is replaced in one step.

    Weights in a file beside it (``.onnx.data``) are packed into it. Raises ``ModelError``, and leaves the file
    unchanged, if its tensors do not agree with the metadata, or if it cannot be written or packed; ``CellwattError`` if
    the package onnx, or onnxruntime, is not installed.
    """
    try:
        import onnx
    except ImportError as error:
        raise CellwattError(
            f"writing metadata into {path} needs onnx ({error}): install it with pip install onnx"
        ) from error
    file = Path(path)
    Network(file, metadata)
    _write(file, onnx.load(file), metadata)


def write_model(path: Path, content: bytes, metadata: Metadata) -> None:
    """Writes an ONNX graph with its metadata; an earlier file is replaced only by a complete one.

    Raises ``ModelError`` where the graph does not agree with the metadata, or the file cannot be written.
    """
    import onnx

    Network(content, metadata)
    _write(path, onnx.load_from_string(content), metadata)


def _write(file: Path, model: Any, metadata: Metadata) -> None:
    from google.protobuf.message import EncodeError
    from onnx.helper import set_model_props

    set_model_props(model, {p.key: p.value for p in model.metadata_props} | {KEY: encode(metadata)})
    try:
        file.parent.mkdir(parents=True, exist_ok=True)
        replace_bytes(file, model.SerializeToString())
    except (ValueError, EncodeError) as error:  # of protobuf
        raise refused(file, "with its weights it is larger than the 2 GiB of an ONNX file") from error
    except OSError as error:
        raise refused(file, f"it cannot be written: {why(error).lower()}") from error
    finally:
        with suppress(OSError):  # it is not there, or its folder is none
            file.with_name(f"{file.name}.part").unlink()


def read_metadata(path: str | PathLike[str]) -> Metadata:
    """Return the metadata of a model file. Raises ``ModelError`` where it is damaged or has none."""
    return metadata_of(OnnxFile(Path(path)))
