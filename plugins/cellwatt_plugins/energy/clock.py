"""Finds the offset between the clocks of analyzer and robot by aligning measured power with the robot's signals."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError
from cellwatt_plugins.energy.recordings import PowerTrace
from cellwatt_plugins.robot.accumulate import Accumulated

FURTHEST = 5.0
"""Largest offset of the clocks, s."""
ALIKE = 0.5
"""Smallest correlation of measured and modelled power."""
STEPS = 6
"""Gauss-Newton steps; the last ones change the offset by microseconds only."""


@dataclass(frozen=True)
class Offset:
    """Analyzer's time minus the robot's time, s, with one standard deviation."""

    seconds: float
    uncertainty: float


def windows(reading: PowerTrace, offset: float) -> tuple[Float, Float]:
    """Start and end (N,) s, robot's time, of the averaging window of each value of the analyzer."""
    middle = reading.time - offset
    return middle - reading.step / 2, middle + reading.step / 2


def inside(reading: PowerTrace, offset: float, modelled: Accumulated) -> NDArray[np.bool_]:
    """True (N,) for values whose whole window the robot recorded."""
    start, end = windows(reading, offset)
    return np.asarray((start >= modelled.start) & (end <= modelled.end))


def align(reading: PowerTrace, modelled: Accumulated, kinds: Accumulated) -> Offset:
    """Offset at which measured and modelled power agree best, to a fraction of a sample.

    The search starts at the offset where ``kinds``, columns (k) of power by kind, explain most of the power, each with
    a free weight, as their shares are not yet known. Raises ``RecordingError`` if they explain too little everywhere.
    """
    coarse = np.arange(-FURTHEST, FURTHEST, reading.step / 4)
    explained = np.array([_explained(reading, kinds, offset) for offset in coarse])
    best = int(np.argmax(explained))
    if not explained[best] > ALIKE**2:
        alike = float(np.sqrt(max(explained[best], 0.0)))
        raise RecordingError(
            f"{reading.place}: its power does not follow the robot's motion (correlation {alike:.2f} at best): "
            f"do the two files belong together, with clocks less than {FURTHEST:g} s apart?"
        )
    return refine(reading, modelled, float(coarse[best]))


def _explained(reading: PowerTrace, kinds: Accumulated, offset: float) -> float:
    """Share of the variance of measured power that the kinds of power explain at an offset."""
    design = kinds.between(*windows(reading, offset)) / reading.step
    design = np.column_stack([design, np.ones(len(design))])
    residual = reading.power - design @ np.linalg.lstsq(design, reading.power, rcond=None)[0]
    variance = float(np.var(reading.power))
    return 1.0 - float(np.var(residual)) / variance if variance > 0 else 0.0


def refine(reading: PowerTrace, modelled: Accumulated, offset: float) -> Offset:
    """Refine a near ``offset`` by least squares of measured on modelled power, with free scale and level."""
    uncertainty = reading.step
    for _ in range(STEPS):
        used = inside(reading, offset, modelled)
        start, end = (edge[used] for edge in windows(reading, offset))
        model = modelled.between(start, end) / reading.step
        h = reading.step / 10
        slope = (modelled.between(start - h, end - h) - modelled.between(start + h, end + h)) / (2 * h * reading.step)
        design = np.stack([np.ones_like(model), model, slope], axis=1)
        found, *_ = np.linalg.lstsq(design, reading.power[used], rcond=None)
        scatter = float(np.std(reading.power[used] - design @ found))
        information = np.linalg.pinv(design.T @ design)
        scale = found[1] if abs(found[1]) > 1e-6 else 1.0
        offset += float(np.clip(found[2] / scale, -reading.step, reading.step))
        uncertainty = scatter * float(np.sqrt(information[2, 2])) / abs(float(scale))
    return Offset(offset, uncertainty)
