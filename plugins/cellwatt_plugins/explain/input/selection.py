"""Select, among many recordings, those in which effects are searched; the others are compared with the model found.

Searching all recordings would leave fewer samples of each, too few to show what a joint does within a tenth of a
second: the more was recorded, the less would be found.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice

import numpy as np

from cellwatt.arrays import Float
from cellwatt.scheduler import spread
from cellwatt_plugins.explain.input.reading import RATE, SAMPLES, read_source, seconds
from cellwatt_plugins.explain.input.sources import Source
from cellwatt_plugins.robot import RobotDescription

FEW = 6
"""Number of recordings up to which all are searched, of any length; of more, this many if ``SLOWEST`` allows."""
LEAST = 2
"""Smallest number of recordings that are searched."""
SLOWEST = 100.0
"""Samples per second with which fast effects are found almost as well as with ``RATE``."""


def select(files: Sequence[Source], robot: RobotDescription) -> tuple[list[Source], list[Source]]:
    """Return the recordings to be searched, those whose motions differ most, and the other recordings.

    All are searched if they are few or short. Raises ``RecordingError`` if a file cannot be read.
    """
    if len(files) <= FEW:
        return list(files), []
    looked = spread(_look, files, "looking at recordings", shared=robot)
    lengths = np.array([length for length, _ in looked])
    if SAMPLES / lengths.sum() >= SLOWEST:
        return list(files), []
    enough = LEAST + int(SAMPLES / SLOWEST / lengths.min())
    order = list(islice(furthest_first(np.stack([motion for _, motion in looked])), enough))
    best, most = np.searchsorted(np.cumsum(lengths[order]), [SAMPLES / RATE, SAMPLES / SLOWEST], side="right").tolist()
    close = set(order[: max(LEAST, best, min(FEW, most))])
    chosen, others = ([file for i, file in enumerate(files) if (i in close) == wanted] for wanted in (True, False))
    return chosen, others


def furthest_first(places: Float) -> Iterator[int]:
    """Indices of the rows (N, m): first the row furthest from the mean, then always the row furthest from all before.

    Each column is in units of its standard deviation (Gonzalez 1985).
    """
    size = np.std(places, axis=0)
    scaled = (places - np.mean(places, axis=0)) / np.where(size > 0, size, 1.0)
    away = np.sum(scaled**2, axis=1)
    used = np.zeros(len(scaled), bool)
    for turn in range(len(scaled)):
        last = int(np.argmax(np.where(used, -1.0, away)))
        used[last] = True
        yield last
        near = np.sum((scaled - scaled[last]) ** 2, axis=1)
        away = np.minimum(away, near) if turn else near


def _look(file: Source, robot: RobotDescription) -> tuple[float, Float]:
    """Length of a recording, s, without pauses; each joint's least and greatest position, rad, and rms speed, rad/s."""
    signals = read_source(file, robot)
    position = signals.needed("position")
    speed = np.sqrt(np.mean(np.square(np.diff(position, axis=0) / signals.step), axis=0))
    motion = np.concatenate([position.min(axis=0), position.max(axis=0), speed])
    return seconds(signals.parts()), motion
