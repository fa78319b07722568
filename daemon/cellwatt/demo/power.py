"""Power predicted by the demo's model and measured by the board, from the recording of the run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellwatt.record import Recording
from cellwatt.results import Prediction

Float = NDArray[np.float64]

MODEL = "power"
"""Name of the stage in ``demo.yaml``, and of its output."""
MEASURED = "board.supply.power"


def model_file() -> Path:
    """Path of the trained model, which ``bench/models/demo.py`` makes."""
    return Path(__file__).with_name("power.onnx")


def power_of(folder: Path, epoch: float, hooked: float | None) -> dict[str, Any] | None:
    """Root mean square of measured − predicted, W, before and after the spring.

    ``epoch`` and ``hooked`` are the times of the start and of the spring, UTC s; with ``hooked`` None it never
    came. None if nothing was predicted. Raises ``RecordingError`` if there is no recording.
    """
    time, measured, predicted = _both(folder, epoch)
    if not len(time):
        return None
    off = measured - predicted
    before = time < (np.inf if hooked is None else hooked)
    return {
        "frames": len(time),
        "measured_mean_w": _rounded(measured[before].mean()) if before.any() else None,
        "rms_w": _rms(off[before]),
        "rms_after_the_spring_w": _rms(off[~before]),
    }


def _both(folder: Path, epoch: float) -> tuple[Float, Float, Float]:
    """Time (n,) UTC s, measured and predicted power (n,) W of all frames of this run that have both."""
    recording = Recording.open(folder)
    said: dict[int, float] = {}
    for result in recording.results(Prediction):
        if result.model == MODEL:
            said |= dict(zip(result.time, result.outputs[MODEL], strict=True))
    rows = [
        (at * 1e-9, value, said[at])
        for block in recording.frames()
        for at, value in zip(block.time.tolist(), block.values[:, block.layout.index(MEASURED)].tolist(), strict=True)
        if at * 1e-9 >= epoch and at in said
    ]
    table = np.array(rows, np.float64).reshape(-1, 3)
    table = table[np.isfinite(table).all(axis=1)]
    return table[:, 0], table[:, 1], table[:, 2]


def _rms(off: Float) -> float | None:
    return _rounded(np.sqrt(np.mean(off**2))) if off.size else None


def _rounded(value: float) -> float:
    return round(float(value), 2)
