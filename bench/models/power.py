"""Models of moving arms: the paper's two methods and the best one, on emulated arms and on two real ones.

The emulated arms are those of the tests, by plain Newton–Euler; moves that are judged are faster and slower than those
trained on. Each function gives one table.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_limits

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.plugins.models.power.cases import model_of, read_case
from tests.plugins.models.power.emulated_arm import ARMS

from cellwatt_plugins.models.network import Network
from cellwatt_plugins.models.power.api import write
from cellwatt_plugins.models.power.fitting import Fitted
from cellwatt_plugins.models.power.moves import Moves, read_moves
from cellwatt_plugins.models.power.nls import Nls
from cellwatt_plugins.models.power.paper import Seen
from cellwatt_plugins.models.power.scg_network import Scg
from cellwatt_plugins.models.power.scores import Score
from cellwatt_plugins.models.power.training import Trained, estimate, train
from cellwatt_plugins.models.power.tuning import tune
from cellwatt_plugins.robot import Arm
from models import ur3e

SEEDS = (1, 2, 3)
SIZES = (5, 10, 20, 40, 80)
NOISE = {"six axes": 0.7, "seven axes": 0.7, "burdened": 1.2, "rippled": 0.7}
"""W of the emulated power."""
PUBLISHED = {"NLS": 1.54, "SCG": 0.89}
"""%: mean energy error of the paper's worst position."""
ECBOT = (1.45, 5.25)
"""W: lowest and highest test RMSE that the library EcBot reports for UR, Franka and Kinova arms."""
CALLS = 5000


@dataclass(frozen=True)
class Errors:
    """Errors of one method on moves that it has not seen."""

    arm: str
    method: str
    energy_mean: float
    """% a move."""
    energy_worst: float
    power: float
    """W, root mean square."""
    noise: float
    """W of the measurement; NaN where unknown."""
    current: tuple[float, ...]
    """% of each joint's spread."""


@dataclass(frozen=True)
class Size:
    """Errors of the best model by the number of moves trained on; median of several arms."""

    moves: int
    minutes: float
    energy_mean: float
    power_over_noise: float
    current_worst: float
    """% of the spread, worst joint."""


@dataclass(frozen=True)
class Speed:
    """Time of the model file, one frame a call, one thread."""

    window: int
    median: float
    """µs."""
    highest: float
    """99th percentile, µs."""
    processor: float
    """Mean of processor time, µs: what others do on the machine is not in it."""


@dataclass(frozen=True)
class Case:
    """An arm with the moves to train on and those to judge by."""

    arm: Arm
    known: Moves
    unseen: Moves

    @classmethod
    def of(cls, folder: Path, kind: str, seed: int) -> Case:
        """One emulated arm, written to ``folder`` as a user would have it."""
        return cls(*read_case(folder, kind, seed))

    def best(self, known: Moves) -> Fitted:
        with threadpool_limits(1):
            return model_of(known, self.arm)

    def judge(self, fitted: Fitted) -> Score:
        return Score.of(self.unseen, *estimate(fitted, self.unseen, self.arm))


def emulated(work: Path, seeds: Sequence[int] = SEEDS) -> tuple[Errors, ...]:
    """All methods on all kinds of emulated arm."""
    out = []
    for kind in ARMS:
        for seed in seeds:
            case = Case.of(work / f"{kind}-{seed}", kind, seed)
            with threadpool_limits(1):
                scores = {**_papers(case), "best": case.judge(case.best(case.known))}
            out += [_errors(f"{kind}, {seed}", method, score, NOISE[kind]) for method, score in scores.items()]
    return tuple(out)


def learning_curve(work: Path, kind: str = "six axes", seeds: Sequence[int] = SEEDS) -> tuple[Size, ...]:
    """How errors on unseen moves fall with the number of moves recorded."""
    cases = [Case.of(work / f"{kind}-{seed}", kind, seed) for seed in seeds]
    out = []
    for size in SIZES:
        # Evenly spread, as a user would go through the start positions.
        parts = [case.known.only(np.linspace(0, case.known.count - 1, size).astype(int).tolist()) for case in cases]
        scores = [case.judge(case.best(part)) for case, part in zip(cases, parts, strict=True)]
        out.append(
            Size(
                size,
                float(np.median([len(part) * part.step / 60 for part in parts])),
                float(np.median([score.energy_mean or np.nan for score in scores])),
                float(np.median([(score.power or np.nan) / NOISE[kind] for score in scores])),
                100 * float(np.median([max(value or 0.0 for value in score.current) for score in scores])),
            )
        )
    return tuple(out)


def trained_ur3e(data: Path, work: Path) -> tuple[Trained, Moves]:
    """The UR3e's training and its moves."""
    arm = Arm.load(ur3e.write_robot(work))
    moves = read_moves(ur3e.write_moves(data, work), arm.description.names)
    with threadpool_limits(1):
        return train(moves, arm), moves


def errors_ur3e(trained: Trained, moves: Moves) -> tuple[Errors, ...]:
    """UR3e: each of five short moves by models of the other four; the least of them is their mean power."""
    mean = np.empty(len(moves))
    for k in range(moves.count):
        mean[moves.move == k] = moves.power[moves.move != k].mean()
    scores = {"constant": Score.of(moves, mean, np.full(moves.current.shape, np.nan)), **trained.scores}
    return tuple(_errors("UR3e", name, score, trained.power_noise) for name, score in scores.items())


def speed(work: Path) -> Speed:
    """The model file of an emulated arm, run frame by frame."""
    case = Case.of(work / "six axes-1", "six axes", 1)
    fitted = case.best(case.known)
    write(work / "model.onnx", fitted, case.known, case.arm)
    network = Network(work / "model.onnx")
    window = network.metadata.window
    table = np.concatenate([case.unseen.q, case.unseen.qd], axis=1)
    frames = [table[i : i + window][None] if window > 1 else table[i : i + 1] for i in range(CALLS)]
    taken = []
    before = time.process_time()
    for frame in frames:
        start = time.perf_counter()
        network.run(network.cast(frame))
        taken.append(1e6 * (time.perf_counter() - start))
    processor = 1e6 * (time.process_time() - before) / len(frames)
    return Speed(window, float(np.median(taken)), float(np.quantile(taken, 0.99)), processor)


def measured_and_predicted(trained: Trained, moves: Moves) -> dict[str, Any]:
    """Picture: the UR3e's five moves, each predicted by a model of the other four."""
    seconds = np.arange(len(moves)) * moves.step
    lines = [("measured", moves.power), *((name, power) for name, (power, _) in trained.predictions.items())]
    shown = [(name, power) for name, power in lines if name in ("measured", "NLS", "best")]
    traces = [{"type": "scatter", "mode": "lines", "name": n, "x": seconds.tolist(), "y": p.tolist()} for n, p in shown]
    dotted = {"type": "line", "yref": "paper", "y0": 0, "y1": 1, "line": {"dash": "dot"}}
    edges = [float(seconds[a]) for a, _ in moves.bounds()[1:]]
    shapes = [dotted | {"x0": edge, "x1": edge} for edge in edges]
    return _figure(traces, "s of motion", "W", shapes)


def learning_picture(sizes: Sequence[Size]) -> dict[str, Any]:
    """Picture: errors by the number of moves."""
    moves = [size.moves for size in sizes]
    curves = {
        "energy error a move, %": [size.energy_mean for size in sizes],
        "power error over its noise": [size.power_over_noise for size in sizes],
        "worst current error, % of spread": [size.current_worst for size in sizes],
    }
    traces = [{"type": "scatter", "mode": "lines+markers", "name": n, "x": moves, "y": y} for n, y in curves.items()]
    figure = _figure(traces, "moves recorded", "error on unseen moves", [])
    figure["layout"]["xaxis"] |= {"type": "log", "tickvals": moves}
    figure["layout"]["yaxis"] |= {"type": "log"}
    return figure


def _papers(case: Case) -> dict[str, Score]:
    tuning = tune(case.known, case.arm)
    seen = Seen.of(case.known, case.arm, tuning)
    here = Seen.of(case.unseen, case.arm, tuning)
    found = {"NLS": Nls.fit(case.known, seen, case.arm.description), "SCG": Scg.fit(case.known, seen)}
    return {name: Score.of(case.unseen, *method.predict(here)) for name, method in found.items()}


def _errors(arm: str, method: str, score: Score, noise: float) -> Errors:
    return Errors(
        arm,
        method,
        score.energy_mean if score.energy_mean is not None else np.nan,
        score.energy_worst if score.energy_worst is not None else np.nan,
        score.power if score.power is not None else np.nan,
        noise,
        tuple(100 * value for value in score.current if value is not None),
    )


def _figure(traces: list[dict[str, Any]], x: str, y: str, shapes: list[dict[str, Any]]) -> dict[str, Any]:
    layout = {
        "width": 760,
        "height": 360,
        "margin": {"l": 60, "r": 20, "t": 20, "b": 50},
        "xaxis": {"title": {"text": x}},
        "yaxis": {"title": {"text": y}},
        "shapes": shapes,
        "legend": {"orientation": "h", "y": 1.1},
    }
    return {"data": traces, "layout": layout}
