"""How long the static paper's networks are trained, and what becomes of their order: the print does not say how long.

Its neurons, 216 and 475, on arms emulated by MuJoCo. Two readings of its hybrid: the network learns what gravity leaves
of the sum of torques ("estimating the error"), or the sum itself ("the output variable is the absolute sum").
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from cellwatt_plugins.models.static.paper import split, trained
from cellwatt_plugins.models.static.training import Scores
from models.static import COUNT, Spread, collected

COURSE = (10, 30, 100, 200, 500)
"""Epochs."""
NEURONS = {"network": 216, "hybrid on the residual": 475, "hybrid as printed": 475}
METHODS = ("gravity", *NEURONS)


@dataclass(frozen=True)
class Held:
    """A collection of one arm: angles (N, 6), their gravity torques (N, 6) and the measured sums (N,)."""

    q: np.ndarray
    gravity: np.ndarray
    total: np.ndarray

    def said(self, method: str, rows: np.ndarray, epochs: int) -> np.ndarray:
        """Sums (N,) by a method that was trained on ``rows``."""
        simulated, both = np.abs(self.gravity).sum(axis=1), np.hstack([self.q, self.gravity])
        if method == "gravity":
            return simulated
        inputs = self.q if method == "network" else both
        start = simulated if method == "hybrid on the residual" else np.zeros_like(simulated)
        network = trained(inputs[rows], self.total[rows] - start[rows], NEURONS[method], epochs)
        return np.asarray(start + network(inputs))


@dataclass(frozen=True)
class Row:
    """One method after so many epochs, over the arms; gravity has none."""

    method: str
    epochs: int
    left_out: int
    rmse_nm: Spread
    r2: Spread
    mape_percent: Spread


@dataclass(frozen=True)
class EpochTables:
    """The course, and on how many arms the hybrid beats gravity and the network."""

    rows: tuple[Row, ...]
    in_order: dict[int, tuple[int, int]]
    """Epochs → arms on which the hybrid is best, on the residual and as printed."""
    arms: int


def held_by(seed: int) -> Held:
    """The collection of one arm."""
    with tempfile.TemporaryDirectory() as folder:
        _, arm, poses = collected(seed, Path(folder))
    return Held(poses.q, arm.basis(poses).vertical @ arm.effects(poses).cad, poses.total)


def scores(held: Held, method: str, epochs: int) -> Scores:
    """On the share left out."""
    rows, test = split(len(held.q))
    return Scores.of(held.total[test], held.said(method, rows, epochs)[test])


def run(arms: int = 3) -> EpochTables:
    """All of it."""
    with threadpool_limits(1):
        held = [held_by(seed) for seed in range(arms)]
        course = {
            (method, epochs): [scores(each, method, epochs) for each in held]
            for method in METHODS
            for epochs in (COURSE if method in NEURONS else COURSE[:1])
        }
    return EpochTables(
        tuple(_row(method, epochs, found) for (method, epochs), found in course.items()),
        {epochs: _in_order(course, epochs, arms) for epochs in COURSE},
        arms,
    )


def picture(tables: EpochTables) -> dict[str, Any]:
    """Median R² over epochs."""
    traces = []
    for method in METHODS:
        rows = [row for row in tables.rows if row.method == method]
        x = list(COURSE) if method in NEURONS else [COURSE[0], COURSE[-1]]
        y = [row.r2.median for row in rows] * (1 if method in NEURONS else 2)
        traces.append({"x": x, "y": y, "mode": "lines+markers" if method in NEURONS else "lines", "name": method})
    below = {"title": {"text": "epochs"}, "type": "log", "tickvals": list(COURSE)}
    beside = {"title": {"text": "R² on poses left out"}}
    return {"data": traces, "layout": {"width": 640, "height": 420, "xaxis": below, "yaxis": beside}}


def _row(method: str, epochs: int, found: Sequence[Scores]) -> Row:
    def over(what: Callable[[Scores], float]) -> Spread:
        return Spread.of([what(each) for each in found])

    left_out = len(split(COUNT)[1])
    return Row(method, epochs, left_out, over(lambda s: s.rmse), over(lambda s: s.r2), over(lambda s: s.mape))


def _in_order(course: dict[tuple[str, int], list[Scores]], epochs: int, arms: int) -> tuple[int, int]:
    gravity = course["gravity", COURSE[0]]
    plain = course["network", epochs]

    def best(method: str) -> int:
        found = course[method, epochs]
        return sum(found[k].rmse < min(gravity[k].rmse, plain[k].rmse) for k in range(arms))

    return best("hybrid on the residual"), best("hybrid as printed")
