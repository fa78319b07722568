"""Emulated arms as a training sees them: the described arm and its moves."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyarrow as pa

from cellwatt_plugins.models.power.fitting import Fitted, fit, structure_of
from cellwatt_plugins.models.power.moves import Moves, read_moves
from cellwatt_plugins.models.power.shown import through_its_meter
from cellwatt_plugins.models.power.smoothing import Noise, Smoother, Span
from cellwatt_plugins.models.power.tuning import Tuning, tune
from cellwatt_plugins.robot import Arm
from tests.plugins.models.power.emulated_arm import recorded, six_axes, write_case, write_known


def read_case(folder: Path, kind: str, seed: int, **counts: int) -> tuple[Arm, Moves, Moves]:
    """The arm of a written case, its moves for the training, and unseen ones."""
    robot, *tables = write_case(folder, kind, seed, **counts)
    arm = Arm.load(robot)
    known, unseen = (read_moves([table], arm.description.names) for table in tables)
    return arm, known, unseen


def model_of(moves: Moves, arm: Arm) -> Fitted:
    """The best model alone, without scores, in seconds."""
    moves = through_its_meter(moves, arm)
    tuning = tune(moves, arm)
    return fit(moves, arm, tuning, structure_of(moves, arm, tuning))


def six_axes_recorded(folder: Path, seed: int, moves: int, speeds: tuple[float, float]) -> tuple[Arm, pa.Table]:
    """An arm of six axes, and the table of a few moves."""
    draw = np.random.default_rng(seed)
    true = six_axes(draw)
    return Arm.load(write_known(true, folder, draw)), recorded(true, draw, moves, speeds)


def tuning_of(moves: Moves) -> Tuning:
    """Windows and width as a training might find them."""
    return Tuning(Smoother.design(Noise(2e-5, 2.5e-3), moves.step, Span(9, 2), Span(11, 3)), 0.005)
