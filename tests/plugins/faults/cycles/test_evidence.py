import numpy as np
import pytest
from scipy.stats import multivariate_normal

from cellwatt_plugins.faults.cycles.evidence import fit, gram


def test_it_is_the_ratio_of_gaussian_likelihoods():
    random = np.random.default_rng(3)
    y, columns, harmless = random.normal(size=12), random.normal(size=(12, 2)), random.normal(size=(12, 3))
    noise = random.uniform(0.5, 2.0, 12)
    without = np.diag(noise**2) + harmless @ harmless.T
    expected = multivariate_normal(cov=without + columns @ columns.T).logpdf(y) - multivariate_normal(
        cov=without
    ).logpdf(y)
    found = fit(gram(y, columns, noise, harmless), np.array([0, 1]))
    assert found.gain == pytest.approx(expected)


def test_sizes_are_found_beside_what_is_harmless():
    random = np.random.default_rng(4)
    column, harmless = random.normal(size=(400, 1)), 5.0 * random.normal(size=(400, 1))
    y = 1.5 * column[:, 0] + 2.0 * harmless[:, 0] + 0.3 * random.normal(size=400)
    found = fit(gram(y, column, np.full(400, 0.3), harmless), np.array([0]))
    assert abs(found.sizes[0] - 1.5) < 4 * found.error[0]
    assert found.error[0] == pytest.approx(0.3 / 20, rel=0.2)


def test_what_is_not_there_is_not_believed():
    random = np.random.default_rng(5)
    columns = random.normal(size=(400, 30))
    products = gram(random.normal(size=400), columns, np.ones(400), np.empty((400, 0)))
    assert max(fit(products, np.array([k])).gain for k in range(30)) < 3.0
