"""Layouts of channels by their units, and frames whose times are known exactly."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from cellwatt import FrameChannel, Frames, Layout


def layout_of(units: Mapping[str, str], rate: float = 50.0) -> Layout:
    """A layout of continuous channels, each with its unit."""
    return Layout(tuple(FrameChannel(name, unit, "continuous", "linear") for name, unit in units.items()), rate)


def frames_of(layout: Layout, sequence: int, time: ArrayLike, values: np.ndarray, quality: ArrayLike = 0) -> Frames:
    """Frames at times, UTC ns, that are known exactly; ``quality`` is of all values, or of each."""
    times, bound = np.asarray(time, np.int64), np.zeros(values.shape, np.int64)
    return Frames(layout, sequence, times, values, np.full(values.shape, quality, np.uint8), bound)


def marked(values: np.ndarray) -> np.ndarray:
    """The quality of values of which those that are NaN are missing."""
    return np.where(np.isnan(values), 4, 0)


def same_frames(a: Frames, b: Frames) -> bool:
    """Equal to the last bit."""
    arrays = "time", "values", "quality", "bound"
    alike = all(getattr(a, name).tobytes() == getattr(b, name).tobytes() for name in arrays)
    return alike and (a.layout, a.sequence, len(a)) == (b.layout, b.sequence, len(b))
