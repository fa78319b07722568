"""Møller's algorithm on problems whose minimum is known, beside scipy's minimisers."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize, rosen, rosen_der

from cellwatt_plugins.models.power.scg import minimise


def rosenbrock(x):
    return float(rosen(x)), np.asarray(rosen_der(x))


@pytest.mark.parametrize("size", [2, 10])
def test_rosenbrock_valley(size):
    start = np.full(size, -1.2)
    found = rosen(minimise(rosenbrock, start, 5000, 1e-8))
    scipys = minimize(rosen, start, jac=rosen_der, method="CG", options={"gtol": 1e-8, "maxiter": 5000})
    assert found < 1e-12 or found <= scipys.fun + 1e-9


def test_curvature_that_is_negative_at_the_start():
    """Equation (8): λ is raised until the step leads down."""

    def function(x):
        return float(np.cos(x[0]) + 0.1 * x[0] ** 2), np.array([-np.sin(x[0]) + 0.2 * x[0]])

    found, _ = function(minimise(function, np.array([0.3]), 200, 1e-9))
    reference = minimize(lambda x: function(x)[0], [2.0], method="BFGS", options={"gtol": 1e-9})
    assert found == pytest.approx(reference.fun, abs=1e-9)
