import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cellwatt_plugins.robot.blocks import Block, Design, Regression
from cellwatt_plugins.robot.regression import Prior

ROWS, CHANNELS = 25, 2


def spread_matrix(random, size):
    root = random.standard_normal((size, size))
    return root @ root.T + 0.3 * np.eye(size)


def full(block):
    """A block as columns of all channels, stacked channel by channel: (CHANNELS · ROWS, m)."""
    out = np.zeros((CHANNELS, ROWS, block.size))
    for channel in range(CHANNELS):
        if block.channel is None:
            out[channel] = block.columns[:, channel]
        elif block.channel == channel:
            out[channel] = block.columns
    return out.reshape(-1, block.size)


class Case:
    """A random problem, and its exact normal distribution."""

    def __init__(self, seed):
        random = np.random.default_rng(seed)
        self.target = 2 * random.standard_normal((ROWS, CHANNELS))
        self.variance = random.uniform(0.3, 3, (ROWS, CHANNELS))
        self.factor = random.uniform(1, 6, CHANNELS)

        def block(channel, size, mean):
            shape = (ROWS, CHANNELS, size) if channel is None else (ROWS, size)
            prior = Prior(mean * random.standard_normal(size), spread_matrix(random, size))
            return Block(random.standard_normal(shape), channel, prior)

        self.fixed = [block(None, 3, 0.0), block(0, 1, 0.0), block(1, 2, 1.0)]
        self.added = [block(1, 1, 1.0), block(None, 2, 0.5)]
        self.tried = [block(0, 2, 1.0), block(None, 1, 0.0), block(1, 1, 0.0)]
        self.regression = Regression(Design(self.target, self.variance, self.fixed), self.added, self.factor)
        self.noise = (self.variance * self.factor).T.ravel()

    def log_evidence(self, blocks):
        from scipy import stats

        """Of the target under the blocks' priors and the noise, each coefficient integrated out."""
        mean, covariance = np.zeros(CHANNELS * ROWS), np.diag(self.noise)
        for block in blocks:
            columns = full(block)
            mean = mean + columns @ block.prior.mean
            covariance = covariance + columns @ block.prior.covariance @ columns.T
        return stats.multivariate_normal.logpdf(self.target.T.ravel(), mean, covariance)

    def posterior(self, blocks):
        """Mean and covariance of all coefficients by conditioning the joint normal distribution."""
        columns = np.concatenate([full(b) for b in blocks], axis=1)
        means = np.concatenate([b.prior.mean for b in blocks])
        prior = np.zeros((len(means), len(means)))
        at = 0
        for b in blocks:
            prior[at : at + b.size, at : at + b.size] = b.prior.covariance
            at += b.size
        gain = prior @ columns.T @ np.linalg.inv(columns @ prior @ columns.T + np.diag(self.noise))
        return means + gain @ (self.target.T.ravel() - columns @ means), prior - gain @ columns @ prior


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_coefficients_and_covariance_are_those_of_the_joint_distribution(seed):
    case = Case(seed)
    mean, covariance = case.posterior([*case.fixed, *case.added])
    assert np.allclose(case.regression.coefficients, mean, atol=1e-8)
    assert np.allclose(case.regression.covariance, covariance, atol=1e-8)


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10**6))
def test_the_gain_is_the_ratio_of_the_evidences(seed):
    case = Case(seed)
    there = [*case.fixed, *case.added]
    for block in case.tried:
        gain, coefficients = case.regression.gain(block)
        assert gain == pytest.approx(case.log_evidence([*there, block]) - case.log_evidence(there), abs=1e-6)
        assert np.allclose(coefficients, case.posterior([*there, block])[0][-block.size :], atol=1e-8)


def test_correlated_noise_counts_as_fewer_samples():
    """A factor of 4 is a quarter of the rows."""
    rows = np.random.default_rng(6).standard_normal((100, 1))
    block = Block(np.ones((400, 1)), 0, Prior.spread(np.array([1.0])))
    few = Block(np.ones((100, 1)), 0, Prior.spread(np.array([1.0])))
    repeated = Regression(Design(np.repeat(rows, 4, axis=0), np.ones((400, 1)), []), [block], np.array([4.0]))
    once = Regression(Design(rows, np.ones((100, 1)), []), [few], np.ones(1))
    assert repeated.covariance == pytest.approx(once.covariance)
    assert repeated.coefficients == pytest.approx(once.coefficients)
