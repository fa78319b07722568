"""Møller's algorithm on problems whose minimum is known, beside scipy's minimisers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize, rosen, rosen_der

from cellwatt_plugins.models.power.scg import minimise


def rosenbrock(x):
    return float(rosen(x)), np.asarray(rosen_der(x))


@pytest.mark.parametrize("size", [2, 5, 10])
def test_rosenbrock_valley(size):
    start = np.full(size, -1.2)
    found = minimise(rosenbrock, start, 5000, 1e-8)
    scipys = minimize(rosen, start, jac=rosen_der, method="CG", options={"gtol": 1e-8, "maxiter": 5000})
    assert found.converged
    assert found.value < 1e-12 or found.value <= scipys.fun + 1e-9
    assert found.iterations < 5000


def test_quadratic_with_curvatures_far_apart():
    curvature = np.logspace(0, 4, 20)
    slope = np.linspace(-3, 3, 20)
    found = minimise(
        lambda x: (float(0.5 * x @ (curvature * x) - slope @ x), curvature * x - slope), np.zeros(20), 5000
    )
    assert np.abs(found.x - slope / curvature).max() < 1e-6


def test_himmelblau_ends_in_one_of_its_four_minima():
    def function(x):
        a, b = x[0] ** 2 + x[1] - 11, x[0] + x[1] ** 2 - 7
        return float(a * a + b * b), np.array([4 * x[0] * a + 2 * b, 2 * a + 4 * x[1] * b])

    for start in ([0.0, 0.0], [-4.0, 4.0], [4.0, -4.0], [-1.0, -1.0]):
        assert minimise(function, np.array(start), 1000, 1e-8).value < 1e-12


def test_curvature_that_is_negative_at_the_start():
    """Equation (8): λ is raised until the step leads down."""

    def function(x):
        return float(np.cos(x[0]) + 0.1 * x[0] ** 2), np.array([-np.sin(x[0]) + 0.2 * x[0]])

    found = minimise(function, np.array([0.3]), 200, 1e-9)
    reference = minimize(lambda x: function(x)[0], [2.0], method="BFGS", options={"gtol": 1e-9})
    assert found.converged
    assert found.value == pytest.approx(reference.fun, abs=1e-9)


def test_same_minimum_as_scipy_for_a_small_network():
    draw = np.random.default_rng(3)
    x = draw.uniform(-1, 1, (60, 1))
    y = np.sin(3 * x[:, 0])

    def function(w):
        a, b, c = w[:4], w[4:8], w[8:12]
        inside = np.tanh(x * a + b)
        left = inside @ c - y
        back = left[:, None] * c * (1 - inside**2)
        gradient = np.concatenate([(x * back).sum(0), back.sum(0), inside.T @ left])
        return float(0.5 * left @ left + 0.005 * w @ w), gradient + 0.01 * w

    start = draw.normal(size=12)
    found = minimise(function, start, 3000, 1e-7)
    scipys = minimize(lambda w: function(w)[0], start, jac=lambda w: function(w)[1], method="BFGS")
    assert found.value <= scipys.fun + 1e-4


def test_no_step_leads_up_and_the_watch_ends_it():
    values = []

    def watch(step, x):
        values.append(rosenbrock(x)[0])
        return len(values) == 10

    minimise(rosenbrock, np.full(4, -1.2), 1000, watch=watch)
    assert len(values) == 10
    assert values == sorted(values, reverse=True)


def test_a_minimum_at_the_start_is_left_alone():
    found = minimise(rosenbrock, np.ones(3), 100)
    assert (found.iterations, found.converged) == (0, True)
