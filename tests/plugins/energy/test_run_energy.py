"""What is refused: parameters that are not known, power that contradicts the model, torque that is reversed."""

from dataclasses import replace

import numpy as np
import pytest

from cellwatt_plugins.energy.drive import bus_power
from cellwatt_plugins.energy.run_energy import Learnt, run_energy
from cellwatt_plugins.robot import Arm


@pytest.fixture
def told(measured, outcome):
    arm = Arm.load(measured[1])
    runs = outcome.findings.runs
    fastest = max(range(len(runs)), key=lambda i: runs[i].regeneration)

    def energy(identified, count=20):
        draws = identified.drawn(np.random.default_rng(1), count)
        return run_energy(identified.observed[fastest], Learnt(arm, outcome.findings.fixed, identified.drive, draws))

    return energy, fastest


def test_regeneration_that_is_hardly_known_is_not_told(outcome, told):
    vague = replace(outcome.identified, covariance=outcome.identified.covariance * 1e6)
    run = told[0](vague)
    assert run.regeneration is None
    assert run.electrical_losses is None
    assert run.electrical_losses_with_regeneration > 0
    assert "not separated from electrical losses" in run.notes[0]
    assert told[0](outcome.identified).regeneration is not None


def test_power_that_contradicts_the_model_while_braking_is_told(outcome, told):
    energy, fastest = told
    one = outcome.identified.observed[fastest]
    reading, motion = one.run.reading, one.run.motion
    braking = np.maximum(-bus_power(outcome.identified.drive, one.feature), 0.0)
    at = np.interp(reading.time - one.offset.seconds, motion.time, np.convolve(braking, np.ones(10) / 10, "same"))
    run = replace(one.run, reading=replace(reading, power=reading.power + 0.7 * at))
    observed = list(outcome.identified.observed)
    observed[fastest] = replace(one, run=run)
    refused = energy(replace(outcome.identified, observed=tuple(observed)))
    assert refused.regeneration is None
    assert "while braking the analyzer differs from the model" in refused.notes[0]


def test_a_negative_loss_is_never_reported(outcome, told):
    drive = outcome.identified.drive
    run = told[0](replace(outcome.identified, drive=replace(drive, torque=-drive.torque)))
    assert run.mechanical_losses == 0
    assert "which is impossible: reported as 0" in run.notes[0]
    rest = run.electronics + run.brakes + run.electrical_losses_with_regeneration
    assert rest == pytest.approx(run.total)
