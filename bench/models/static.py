"""Models of held poses on emulated arms: the paper's methods and the best one, how few poses do, speed of the file.

The arms are emulated by another physics engine; every figure is the median, lowest and highest over several arms.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

from cellwatt.arrays import rows_of
from cellwatt_plugins.models.network import Network
from cellwatt_plugins.models.static.identify import HeldArm, identify
from cellwatt_plugins.models.static.poses import Poses, read_poses
from cellwatt_plugins.models.static.training import PUBLISHED, Scores, Trained, train, write
from cellwatt_plugins.robot import Arm
from models import held_arms

COUNT = 532
SIZES = (20, 40, 80, 160, 320, 532)
METHODS = ("gravity", "network", "hybrid", "best")


@dataclass(frozen=True)
class Spread:
    """A figure over the arms."""

    median: float
    lowest: float
    highest: float

    @classmethod
    def of(cls, values: list[float]) -> Spread:
        return cls(float(np.median(values)), float(min(values)), float(max(values)))


@dataclass(frozen=True)
class MethodRow:
    """One method on the fifth of a collection that it had not seen, as in the paper, and on poses never collected.

    ``published`` are RMSE, R² and MAPE of the paper's arm.
    """

    method: str
    rmse_nm: Spread
    r2: Spread
    mape_percent: Spread
    never_collected_r2: Spread
    published: tuple[float, float, float] | None


@dataclass(frozen=True)
class PosesRow:
    """The best model trained on the first so many poses."""

    poses: int
    rmse_nm: Spread
    r2: Spread


@dataclass(frozen=True)
class StaticTables:
    """What `train static` is worth."""

    methods: tuple[MethodRow, ...]
    poses: tuple[PosesRow, ...]
    coverage_percent: Spread
    """Share of true sums within the 90 % interval."""
    in_order: int
    """Arms on which the hybrid beats gravity and the network, and the best model the hybrid."""
    arms: int
    arms_of_few: int
    training_s: Spread
    """Processor time, one thread: what others do on the machine is not in it."""
    frame_us: Spread
    """One pose through model.onnx, one thread."""


@dataclass(frozen=True)
class Case:
    """One arm, trained."""

    scores: dict[str, Scores]
    coverage: float
    training_s: float
    frame_us: float
    measured: np.ndarray
    predicted: dict[str, np.ndarray]
    trained: Trained


def collected(seed: int, folder: Path) -> tuple[held_arms.HeldArm, HeldArm, Poses]:
    """An arm as it really is, the same arm as its user knows it, and 532 poses as the user has them."""
    really = held_arms.some_arm(seed)
    described = Arm.load(held_arms.write_robot(folder))
    held_arms.write_samples(held_arms.collection(really, seed, COUNT), folder / "samples.parquet")
    poses = read_poses([folder / "samples.parquet"], described.description)
    return really, HeldArm.of(described, poses.q), poses


def case(seed: int, folder: Path) -> Case:
    """Collects, trains, writes the files and asks them for poses never collected."""
    really, arm, poses = collected(seed, folder)
    start = time.process_time()
    with threadpool_limits(1):
        trained = train(poses, arm)
    seconds = time.process_time() - start
    best, *paper = write(trained, arm, folder)
    q, came, torque = held_arms.unseen(really, seed)
    network = Network(best)
    said = network.run(np.hstack([q, q - came]))
    predicted = {file.stem: Network(file).run(q)[:, 0] for file in paper} | {"best": said[:, 6]}
    total = np.abs(torque).sum(axis=1)
    inside = (said[:, 7] <= total) & (total <= said[:, 8])
    scores = {name: Scores.of(total, value) for name, value in predicted.items()}
    return Case(scores, 100 * float(inside.mean()), seconds, _frame(network, q[:1]), total, predicted, trained)


def few_poses(seed: int, folder: Path) -> dict[int, Scores]:
    """The best model's physics from the first poses only."""
    really, arm, poses = collected(seed, folder)
    q, came, torque = held_arms.unseen(really, seed)
    new = Poses(q, np.zeros_like(q), q - came, np.full(len(q), np.nan))
    out = {}
    for size in SIZES:
        some = rows_of(poses, np.arange(size))
        with threadpool_limits(1):
            model = identify(arm.basis(some), some.torque, arm.effects(some))
        out[size] = Scores.of(np.abs(torque).sum(axis=1), model.total(arm.basis(new)))
    return out


def run(arms: int = 5, arms_of_few: int = 12) -> tuple[StaticTables, Case]:
    """The tables, and the first arm's case for the pictures."""
    with tempfile.TemporaryDirectory() as folder:
        cases = [case(seed, Path(folder)) for seed in range(arms)]
        curves = [few_poses(seed, Path(folder)) for seed in range(arms_of_few)]
    return StaticTables(
        tuple(_method(name, cases) for name in METHODS),
        tuple(_poses(size, [curve[size] for curve in curves]) for size in SIZES),
        Spread.of([c.coverage for c in cases]),
        sum(_ordered({m.name: m.scores for m in c.trained.methods}) for c in cases),
        arms,
        arms_of_few,
        Spread.of([c.training_s for c in cases]),
        Spread.of([c.frame_us for c in cases]),
    ), cases[0]


def pictures(tables: StaticTables, first: Case) -> dict[str, dict[str, Any]]:
    """Figures as plotly writes them: predicted over true torques, and the error by number of poses."""
    return {"static-scatter": scatter(first), "static-learning": learning(tables.poses)}


def scatter(first: Case) -> dict[str, Any]:
    """Poses never collected, each method."""
    true = first.measured.tolist()
    ends = [min(true), max(true)]
    traces = [{"x": ends, "y": ends, "mode": "lines", "name": "exact"}]
    traces += [{"x": true, "y": first.predicted[n].tolist(), "mode": "markers", "name": n} for n in METHODS]
    axes = {"xaxis": _axis("true sum of torques, Nm"), "yaxis": _axis("predicted, Nm")}
    return {"data": traces, "layout": {"width": 640, "height": 520, **axes}}


def learning(rows: Sequence[PosesRow]) -> dict[str, Any]:
    """Least, median and greatest error over the arms by the number of poses."""
    sizes = [row.poses for row in rows]
    traces = [
        {"x": sizes, "y": [getattr(row.rmse_nm, what) for row in rows], "mode": "lines+markers", "name": what}
        for what in ("lowest", "median", "highest")
    ]
    below = _axis("poses collected") | {"type": "log", "tickvals": sizes}
    beside = _axis("RMSE on poses never collected, Nm") | {"type": "log"}
    return {"data": traces, "layout": {"width": 640, "height": 420, "xaxis": below, "yaxis": beside}}


def _axis(title: str) -> dict[str, Any]:
    return {"title": {"text": title}}


def _method(name: str, cases: list[Case]) -> MethodRow:
    split = [m.scores for c in cases for m in c.trained.methods if m.name == name]
    spreads = (Spread.of([getattr(s, what) for s in split]) for what in ("rmse", "r2", "mape"))
    never = Spread.of([c.scores[name].r2 for c in cases])
    return MethodRow(name, *spreads, never_collected_r2=never, published=PUBLISHED.get(name))


def _poses(size: int, scores: list[Scores]) -> PosesRow:
    return PosesRow(size, Spread.of([s.rmse for s in scores]), Spread.of([s.r2 for s in scores]))


def _ordered(scores: dict[str, Scores]) -> bool:
    hybrid = scores["hybrid"].rmse
    return scores["best"].rmse < hybrid < min(scores["gravity"].rmse, scores["network"].rmse)


def _frame(network: Any, pose: np.ndarray, calls: int = 5000) -> float:
    """Median time, µs, of one pose a call."""
    given = np.hstack([pose, pose])
    taken = np.empty(calls)
    for i in range(calls):
        start = time.perf_counter_ns()
        network.run(given)
        taken[i] = time.perf_counter_ns() - start
    return float(np.median(taken)) / 1e3
