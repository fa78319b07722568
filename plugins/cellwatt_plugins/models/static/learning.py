"""Learning curve: error by number of poses, and the number above which more poses no longer help."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from cellwatt.scheduler import spread
from cellwatt_plugins.models.static.basis import Basis
from cellwatt_plugins.models.static.effects import Effects
from cellwatt_plugins.models.static.identify import identify
from cellwatt_plugins.models.static.poses import Poses

SIZES: Final = (20, 40, 80, 160, 320, 640)
REPEATS: Final = 3
_LARGEST: Final = 0.8  # of the poses; the rest are for testing
ENOUGH: Final = 1.05
"""Factor by which twice as many poses must reduce the error for more poses to help."""


@dataclass(frozen=True)
class Point:
    """Errors of models of this number of random poses, on the other poses."""

    poses: int
    rmse: float
    """Nm, of the sum of absolute torques; root mean square over the draws."""
    lowest: float
    highest: float
    """Nm, smallest and largest error of a single draw."""


@dataclass(frozen=True)
class Curve:
    """Error by number of poses; ``floor`` Nm is the scatter of repeated measurements of one pose."""

    points: tuple[Point, ...]
    floor: float
    reached: float
    """Nm: RMSE on held-out poses of models of all others."""
    poses: int

    @property
    def enough(self) -> int | None:
        """Smallest number of poses that is as good as all; None if all are not enough yet."""
        tried = [*((p.poses, p.rmse) for p in self.points), (self.poses, self.reached)]
        if len(tried) < 2 or tried[-2][1] > ENOUGH * tried[-1][1]:
            return None
        return next(count for count, rmse in tried if rmse <= ENOUGH * self.reached)

    def as_json(self) -> dict[str, Any]:
        """Return the curve as ``--json`` prints it."""
        return {**asdict(self), "enough": self.enough}

    def in_words(self) -> str:
        """Advice on the number of poses."""
        floor = min(self.floor, self.reached)
        error = f"{self.reached:.2f} Nm on poses left out, of which {floor:.2f} Nm is the scatter of a pose"
        if self.enough is None:
            return f"More poses would still help: with {self.poses} the error is {error}."
        if self.enough == self.poses:
            return f"{self.poses} poses are just enough: the error is {error}."
        return f"More poses would no longer help: {self.enough} are as good as all {self.poses}; the error is {error}."


def learning_curve(poses: Poses, basis: Basis, effects: Effects, floor: float, reached: float, seed: int) -> Curve:
    """Train on some of the poses, ``REPEATS`` times for each number; physics alone."""
    sizes = [size for size in SIZES if size <= _LARGEST * len(poses)]
    draws = [(seed, size, repeat) for size in sizes for repeat in range(REPEATS)]
    errors = spread(_error, draws, "models of fewer poses", shared=(poses, basis, effects))
    points = []
    for k, size in enumerate(sizes):
        found = errors[k * REPEATS : (k + 1) * REPEATS]
        together = float(np.sqrt(np.mean(np.square(found))))
        points.append(Point(size, together, min(found), max(found)))
    return Curve(tuple(points), floor, reached, len(poses))


def _error(draw: tuple[int, int, int], known: tuple[Poses, Basis, Effects]) -> float:
    """Root mean square error in Nm, on the other poses, of a model of poses drawn by seed, size and repeat."""
    poses, basis, effects = known
    rows = np.random.default_rng(draw).permutation(len(poses))
    size = draw[1]
    model = identify(basis.rows(rows[:size]), poses.torque[rows[:size]], effects)
    rest = rows[size:]
    return float(np.sqrt(np.mean((model.total(basis.rows(rest)) - poses.total[rest]) ** 2)))
