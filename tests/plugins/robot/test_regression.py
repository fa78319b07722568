"""Least squares with normal priors, against normal distributions written out in full."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from cellwatt_plugins.robot.regression import Prior, Products, Whitener, gauss_newton, solve, variance_of


class Case:
    """Four coefficients in 30 rows of unequal noise."""

    def __init__(self, seed=0):
        random = np.random.default_rng(seed)
        self.matrix, self.target = random.normal(size=(30, 4)), 2 * random.normal(size=30)
        self.variance = random.uniform(0.3, 3.0, 30)
        root = random.normal(size=(4, 4))
        self.prior = Prior(random.normal(size=4), root @ root.T + 0.3 * np.eye(4))
        self.fit = solve(self.matrix, self.target, self.variance, self.prior)

    def log_evidence(self, prior, matrix):
        from scipy import stats

        covariance = matrix @ prior.covariance @ matrix.T + np.diag(self.variance)
        return stats.multivariate_normal.logpdf(self.target, matrix @ prior.mean, covariance)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_the_evidence_is_the_ratio_of_the_likelihoods(seed):
    from scipy import stats

    case = Case(seed)
    none = stats.multivariate_normal.logpdf(case.target, np.zeros(30), np.diag(case.variance))
    assert case.fit.evidence == pytest.approx(case.log_evidence(case.prior, case.matrix) - none, abs=1e-7)


def test_the_gain_of_a_part_is_that_of_the_fit_with_it_over_the_fit_without():
    case = Case(1)
    first, last = (Prior(case.prior.mean[p], case.prior.covariance[p, p]) for p in (slice(0, 2), slice(2, 4)))
    both = Prior.joined(first, last)
    fit = solve(case.matrix, case.target, case.variance, both)
    expected = case.log_evidence(both, case.matrix) - case.log_evidence(first, case.matrix[:, :2])
    assert fit.gain(slice(2, 4)) == pytest.approx(expected)


def test_bounds_give_the_most_probable_of_what_is_allowed():
    case = Case(4)
    lower, upper = np.array([-np.inf, 0.4, -0.2, -np.inf]), np.array([0.1, np.inf, 0.2, np.inf])

    def cost(x):
        off = x - case.prior.mean
        return np.sum((case.target - case.matrix @ x) ** 2 / case.variance) + off @ case.prior.precision @ off

    best = minimize(cost, np.array([0.0, 0.5, 0.0, 0.0]), bounds=list(zip(lower, upper, strict=True)), tol=1e-12)
    assert case.fit.bounded(lower, upper) == pytest.approx(best.x, abs=1e-4)
    assert case.fit.bounded(np.full(4, -np.inf), np.full(4, np.inf)) == pytest.approx(case.fit.coefficients)


def test_a_curve_is_fitted_along_its_slopes():
    time = np.linspace(0.0, 2.0, 80)
    truth = np.array([3.0, 1.7])
    measured = truth[0] * np.exp(-truth[1] * time)

    def linearised(x):
        slope = np.column_stack([np.exp(-x[1] * time), -x[0] * time * np.exp(-x[1] * time)])
        return Products.of(slope, measured - x[0] * np.exp(-x[1] * time) + slope @ x, 1e-6)

    start, prior = np.array([1.0, 1.0]), Prior.spread(np.full(2, 10.0))
    found, fit = gauss_newton(linearised, prior, start, 30, settled=1e-10)
    assert found == pytest.approx(truth, rel=1e-5)
    assert fit.coefficients == pytest.approx(found)
    held, _ = gauss_newton(linearised, prior, start, 30, within=lambda fit: np.minimum(fit.coefficients, 1.5))
    assert held.max() <= 1.5


def test_the_variance_of_a_group_is_its_mean_square_and_no_less_than_the_least():
    residual = np.array([1.0, 3.0, 0.01, 0.01, np.nan, 2.0])
    group = np.array([0, 0, 1, 1, 1, 2])
    assert variance_of(residual, group, 0.04) == pytest.approx([5.0, 5.0, 0.04, 0.04, 0.04, 4.0])
    every = np.nanmean(residual**2)
    assert variance_of(residual, group, 0.0, fewest=2) == pytest.approx([5.0, 5.0, 1e-4, 1e-4, 1e-4, every])


def test_evidence_under_shared_noise_is_that_of_its_covariance():
    from scipy import stats

    random = np.random.default_rng(3)
    y, columns, shared = random.normal(size=12), random.normal(size=(12, 2)), random.normal(size=(12, 3))
    noise = random.uniform(0.5, 2.0, 12)
    without = np.diag(noise**2) + shared @ shared.T
    within = stats.multivariate_normal(cov=without + columns @ columns.T).logpdf(y)
    white = Whitener.of(noise, shared)
    found = solve(white(columns), white(y), 1.0, Prior.spread(np.ones(2)))
    assert found.evidence == pytest.approx(within - stats.multivariate_normal(cov=without).logpdf(y))
