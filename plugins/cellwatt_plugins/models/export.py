"""From a finished graph to a model file that the ``model`` stage and ``cellwatt predict`` run."""

from __future__ import annotations

from pathlib import Path

from cellwatt.errors import ModelError
from cellwatt_plugins.models.describe import describe
from cellwatt_plugins.models.metadata import Input, Metadata

UNITS = {
    "position": "rad",
    "velocity": "rad/s",
    "acceleration": "rad/s^2",
    "torque": "Nm",
    "current": "A",
    "temperature": "degC",
    "approach": "rad",
}
"""Units of the quantities that a joint may have."""


def joint_inputs(joints: int, *quantities: str, optional: bool = False) -> tuple[Input, ...]:
    """``joint_1.position``, ``joint_2.position``, … for each quantity in turn."""
    return tuple(Input(f"joint_{i + 1}.{q}", UNITS[q], optional) for q in quantities for i in range(joints))


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
