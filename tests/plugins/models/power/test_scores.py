"""Errors of predictions."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.scores import Score


def moves_of(starts, power):
    q = np.concatenate([np.full((10, 2), start) + np.linspace(0, 1, 10)[:, None] for start in starts])
    move = np.repeat(np.arange(len(starts)), 10)
    current = np.tile([[1.0, 0.0], [3.0, 0.0]], (len(q) // 2, 1))
    return Moves(move, np.arange(len(q)) * 0.01, q, 0 * q, current, np.asarray(power, float))


def test_energy_power_and_current():
    moves = moves_of([0.0, 1.0], np.full(20, 100.0))
    predicted = np.concatenate([np.full(10, 101.0), np.tile([98.0, 100.0], 5)])
    score = Score.of(moves, predicted, moves.current + np.array([0.1, 0.1]))
    assert score.energy == pytest.approx((1.0, 1.0))
    assert score.power == pytest.approx(np.sqrt((10 + 20) / 20))
    assert score.current[0] == pytest.approx(0.1)  # its spread is 1 A
    assert score.current[1] is None  # never driven
    assert score.current_rms == pytest.approx((0.1, 0.1))
    assert (score.energy_mean, score.energy_worst) == pytest.approx((1.0, 1.0))
