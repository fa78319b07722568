"""One run before the fit: its repetitions, and its two clocks laid over each other."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.energy.clock import Offset, align
from cellwatt_plugins.energy.drive import Drive, motion_features
from cellwatt_plugins.energy.identify import modelled
from cellwatt_plugins.energy.recordings import Recorded
from cellwatt_plugins.energy.repetitions import Repetition, find_repetitions
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.accumulate import Accumulated

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Laid:
    """Complete repetitions of a run, ``notes`` on the others, and how far its clocks are apart."""

    repetitions: tuple[Repetition, ...]
    notes: tuple[str, ...]
    offset: Offset


def laid_over(run: Recorded, known: tuple[Arm, Drive]) -> Laid:
    """Look at one run with a first guess of the arm's drive.

    Raises ``RecordingError`` where no repetition is complete, or power does not follow the motion.
    """
    arm, guess = known
    kept, notes = find_repetitions(run.motion)
    feature = motion_features(arm, run.motion)
    offset = align(run.reading, modelled(run, feature, guess), _sorts_of_power(run, feature, arm.joints))
    return Laid(tuple(kept), tuple(notes), offset)


def _sorts_of_power(run: Recorded, feature: Float, joints: int) -> Accumulated:
    """Every kind of power over all joints, as columns."""
    motion = run.motion
    kinds = feature.reshape(len(feature), -1, joints).sum(axis=2)
    return Accumulated(float(motion.time[0]), motion.step, kinds)
