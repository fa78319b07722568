"""Local polynomials through position and velocity."""

from __future__ import annotations

import numpy as np
import pytest

from cellwatt_plugins.models.graph import Graph
from cellwatt_plugins.models.power import smoothing
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.smoothing import Noise, Smoother, Span
from tests.plugins.models.making import run_graph

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


def test_in_a_graph_it_gives_the_same():
    q, qd, _ = polynomial(60)
    smoother = Smoother.design(NOISE, STEP, Span(7, 2), Span(11, 3))
    moves = move_of(q, qd)
    graph = Graph(columns=5, window=11)
    traced = smoother.trace(graph, joints=2, columns=5)
    here = smoother.trace_as_is(graph, 4, 1)
    table = np.concatenate([q, qd, np.arange(60.0)[:, None]], axis=1)
    windows = np.stack([table[i : i + 11] for i in range(50)])
    found = run_graph(graph, graph.concat([each.name for each in [*traced, here]]), 7, windows)
    rows = np.arange(50) + 10 - smoother.delay
    expected = np.concatenate([each[rows] for each in smoother.apply(moves)], axis=1)
    assert np.abs(found[:, :6] - expected).max() < 1e-9
    assert np.array_equal(found[:, 6], rows)
