"""The network that SCG trains."""

from __future__ import annotations

import numpy as np
from scipy.optimize import check_grad

from cellwatt_plugins.models.power.perceptron import Perceptron, _Shape

DRAW = np.random.default_rng(0)
X = DRAW.normal(size=(400, 3)) * [1, 10, 0.1]


def trained(y):
    return Perceptron.train(X, y, np.arange(len(X)) % 5 == 0, 6, 300, np.zeros(3))


def test_gradient():
    shape = _Shape(3, 4, 2)
    y = DRAW.normal(size=(400, 2))
    w = DRAW.normal(size=shape.weights)
    assert check_grad(lambda w: shape.loss(w, X, y)[0], lambda w: shape.loss(w, X, y)[1], w) < 1e-4


def test_what_is_curved_is_learnt_and_the_same_rows_give_the_same():
    y = np.sin(2 * X[:, :1]) + 0.05 * X[:, 1:2]
    network, again = trained(y), trained(y)
    assert np.sqrt(np.mean((network(X) - y) ** 2)) < 0.1 * y.std()
    assert np.array_equal(network.hidden, again.hidden)
