"""Local polynomials through position and velocity."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt_plugins.models.power import smoothing
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.smoothing import Noise, Smoother, Span

STEP = 0.008
NOISE = Noise(2e-5, 2.5e-3)


def move_of(q, qd):
    nan = np.full(q.shape, np.nan)
    return Moves(np.zeros(len(q), np.int64), np.arange(len(q)) * STEP, q, qd, nan, nan[:, 0])


def polynomial(rows=200):
    t = np.arange(rows) * STEP
    q = np.stack([0.3 + 0.2 * t - 0.5 * t**2, 1 - t + 2 * t**2], axis=1)
    qd = np.stack([0.2 - t, -1 + 4 * t], axis=1)
    return q, qd, np.tile([-1.0, 4.0], (rows, 1))


def test_a_parabola_is_passed_on_as_it_is(monkeypatch):
    monkeypatch.setattr(smoothing, "AT_ONCE", 64)
    q, qd, qdd = polynomial()
    smoother = Smoother.design(NOISE, STEP, Span(11, 2), Span(21, 3))
    moves = move_of(q, qd)
    inside = smoother.whole(moves)
    assert inside.sum() == 180
    assert smoother.delay == 10
    for found, true in zip(smoother.apply(moves), (q, qd, qdd), strict=True):
        assert np.abs(found - true)[inside].max() < 1e-7


def test_noise_falls_as_the_weights_say():
    draw = np.random.default_rng(0)
    moves = move_of(*(sigma * draw.normal(size=(20_000, 2)) for sigma in (NOISE.position, NOISE.velocity)))
    smoother = Smoother.design(NOISE, STEP, Span(15, 2), Span(15, 3))
    each = smoother.weights.reshape(3, -1, 2) * [NOISE.position, NOISE.velocity]
    expected = np.sqrt((each**2).sum(axis=(1, 2)))
    found = [values.std() for values in smoother.apply(moves)]
    assert found == pytest.approx(expected, rel=0.1)
    assert found[1] < 0.4 * NOISE.velocity
