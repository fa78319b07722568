import numpy as np
import pytest

from cellwatt.errors import RecordingError
from cellwatt_plugins.energy.clock import align, refine
from cellwatt_plugins.energy.recordings import PowerTrace
from cellwatt_plugins.robot.accumulate import Accumulated

STEP = 0.01
GRID = np.arange(0, 12, STEP)


def power(time):
    """Three bursts that are alike, as repetitions are."""
    return 90 + sum(60 * np.exp(-(((time - c) / 0.4) ** 2)) for c in (3.0, 6.0, 9.0))


def measured(offset, seed=0, noise=0.3):
    middle = np.arange(0.0437, 11.9, 0.1)
    fine = np.linspace(-0.05, 0.05, 101)
    values = power(middle[:, None] + fine).mean(axis=1)
    return PowerTrace("here", middle + offset, values + np.random.default_rng(seed).normal(0, noise, len(middle)))


@pytest.mark.parametrize("offset", [-0.333, 2.4])
def test_offset_to_a_fraction_of_a_sample(offset):
    # The model is off by a third and a level: only its shape counts.
    modelled = 40 + 0.7 * power(GRID)
    found = align(measured(offset), Accumulated(0.0, STEP, modelled), Accumulated(0.0, STEP, modelled[:, None]))
    assert found.seconds == pytest.approx(offset, abs=0.003)


def test_its_uncertainty_is_honest():
    model = Accumulated(0.0, STEP, power(GRID))
    found = [refine(measured(0.4, seed), model, 0.43) for seed in range(30)]
    pull = [(one.seconds - 0.4) / one.uncertainty for one in found]
    assert 0.5 < np.std(pull) < 1.6


def test_power_of_another_run_is_refused():
    noise = np.random.default_rng(1).normal(90, 5, 120)
    reading = PowerTrace("run.analyzer.parquet", np.arange(120) * 0.1, noise)
    with pytest.raises(RecordingError, match=r"run\.analyzer\.parquet: its power does not follow"):
        modelled = power(GRID)
        align(reading, Accumulated(0.0, STEP, modelled), Accumulated(0.0, STEP, modelled[:, None]))
