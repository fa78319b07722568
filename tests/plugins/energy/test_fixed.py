import numpy as np
import pytest

from cellwatt_plugins.energy.fixed import AtRest, steady_power
from cellwatt_plugins.energy.recordings import PowerTrace


def reading(power):
    return PowerTrace("there", 0.1 * np.arange(len(power)), power)


def test_mean_and_its_uncertainty():
    errors = []
    for seed in range(40):
        state = steady_power(reading(80 + np.random.default_rng(seed).normal(0, 0.3, 600)))
        errors.append((state.power - 80) / state.uncertainty)
        assert state.noise == pytest.approx(0.3, rel=0.15)
        assert state.steady
    assert 0.5 < np.std(errors) < 1.5


def test_a_reading_that_drifts_is_told():
    drifting = steady_power(reading(80 + np.linspace(0, 1.0, 600) + np.random.default_rng(1).normal(0, 0.1, 600)))
    assert not drifting.steady
    assert drifting.drift == pytest.approx(1.0, abs=0.1)
    assert drifting.uncertainty > 0.25
    still = steady_power(reading(np.random.default_rng(2).normal(60, 0.1, 600)))
    (note,) = AtRest(still, drifting, still).notes()
    assert note.startswith("connected: not steady, drifted by +1.0")
