"""Writes metadata into an exported ONNX file, and reads it back."""

from __future__ import annotations

from os import PathLike
from pathlib import Path

from cellwatt.errors import CellwattError, ModelError
from cellwatt_plugins.models.metadata import KEY, Metadata, encode, metadata_of
from cellwatt_plugins.models.network import Network, check_intact
from cellwatt_plugins.models.seal import KEY as SEAL_KEY
from cellwatt_plugins.models.seal import sealed
from cellwatt_plugins.onnx_file import OnnxFile, refused


def describe(path: str | PathLike[str], metadata: Metadata) -> None:
    """Writes metadata, and a digest of the whole, into an ONNX file; the file is replaced in one step.

    Weights that lie in a file beside it (``.onnx.data``) are packed into it, so that the digest covers them. Raises
    ``ModelError``, and leaves the file as it is, where its tensors do not agree with the metadata, or where it cannot
    be written or packed; ``CellwattError`` where the package onnx, or onnxruntime, is not installed.
    """
    try:
        import onnx
        from google.protobuf.message import EncodeError
    except ImportError as error:
        raise CellwattError(
            f"writing metadata into {path} needs onnx ({error}): install it with pip install onnx"
        ) from error
    file = Path(path)
    Network(OnnxFile(file), metadata, file)
    model = onnx.load(file)
    properties = {p.key: p.value for p in model.metadata_props if p.key != SEAL_KEY} | {KEY: encode(metadata)}
    onnx.helper.set_model_props(model, properties)
    partial = file.with_name(f".{file.name}.partial")
    try:
        partial.write_bytes(sealed(model.SerializeToString()))
        partial.replace(file)
    except (ValueError, EncodeError) as error:  # of protobuf
        raise refused(file, "with its weights it is larger than the 2 GiB of an ONNX file") from error
    except OSError as error:
        raise refused(file, f"its metadata cannot be written: {(error.strerror or str(error)).lower()}") from error
    finally:
        partial.unlink(missing_ok=True)


def write_model(path: Path, content: bytes, metadata: Metadata) -> None:
    """Writes an ONNX graph with its metadata; an earlier file is replaced only by one that is whole.

    Raises ``ModelError`` where the graph does not agree with the metadata, or the file cannot be written.
    """
    fresh = path.with_name(f".{path.name}.fresh")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        fresh.write_bytes(content)
        describe(fresh, metadata)
        fresh.replace(path)
    except OSError as error:
        raise ModelError(f"{path} cannot be written: {(error.strerror or str(error)).lower()}") from error
    finally:
        fresh.unlink(missing_ok=True)


def read_metadata(path: str | PathLike[str]) -> Metadata:
    """Return the metadata of a model file. Raises ``ModelError`` where it is damaged or has none."""
    file = Path(path)
    check_intact(file)
    return metadata_of(OnnxFile(file))
