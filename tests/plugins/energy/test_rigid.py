from dataclasses import replace

import numpy as np
import pytest
from energy.arms import make_arm

from cellwatt.errors import RecordingError
from cellwatt_plugins.energy.recordings import read_runs
from cellwatt_plugins.energy.rigid import fit_rigid
from cellwatt_plugins.robot import Arm


def test_a_known_payload_gives_the_gain_of_the_joints_that_carry_it_and_friction(measured):
    """Without the analyzer: links, rotors and friction are off by some per cent or unknown."""
    case, folder, _ = measured
    arm = Arm.load(folder)
    fit = fit_rigid(arm, read_runs(folder / "runs", arm.description.names), np.full(6, 0.15))
    true = make_arm(case)
    assert fit.torque[1:3] == pytest.approx(1 / true.gains[1:3], rel=0.04)
    assert np.all(np.abs(fit.torque - 1 / true.gains)[1:3] < 5 * fit.uncertainty[1:3])

    at = 0.5  # rad/s: viscous, Coulomb and windage are told apart less well than their sum
    laws = ("viscous_friction", "coulomb_friction", "nonlinear_viscous_friction")
    viscous, coulomb, windage = (fit.friction[law] for law in laws)
    found = (viscous * at + coulomb + windage * at**2)[:3]
    assert found == pytest.approx((true.viscous * at + true.coulomb)[:3], rel=0.2)
    assert min(viscous.min(), coulomb.min(), windage.min()) >= 0


def test_runs_with_too_little_motion_are_refused(measured):
    arm = Arm.load(measured[1])
    (run, *_) = read_runs(measured[1] / "runs", arm.description.names)
    names = ("time", "position", "velocity", "torque")
    short = replace(run, motion=replace(run.motion, **{name: getattr(run.motion, name)[:300] for name in names}))
    with pytest.raises(RecordingError, match="no run has 250 samples in motion"):
        fit_rigid(arm, [short], np.full(6, 0.15))
