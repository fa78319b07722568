"""Check that the power is of this arm, and in W."""

from __future__ import annotations

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import RecordingError
from cellwatt.report.numbers import number
from cellwatt_plugins.explain.input.factors import usable
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.robot.motion import Moved

SAMPLES = 2000
HUNDRED = 100.0
"""Factor between the changes of supply power and of joint power that no arm reaches."""
LEAST = 0.03
"""Share of the joints' mean power that the supply must exceed: energy does not come from nowhere."""
ENOUGH = 1.0
"""Joint power, W, mean or standard deviation, above which it can be compared with the supply."""
ALIKE = 0.5
"""Correlation of supply and joint power above which their ratio is meaningful."""


def check_power(run: Run, motion: Moved) -> None:
    """Raises ``RecordingError`` if the power cannot be in W, compared with the mechanical power of the joints."""
    rows = usable(run, SAMPLES)
    if run.power is not None and np.isfinite(run.torque[rows]).all():
        _check(run.name, run.power[rows], np.sum(run.torque[rows] * motion.velocity[rows], axis=1))


def check_simulated_power(run: Run) -> None:
    """``check_power`` for the simulation of a run."""
    simulated = run.simulated
    if simulated is not None and simulated.power is not None:
        joints = np.sum(simulated.torque * simulated.plan.velocity, axis=1)
        _check(f"{run.name}: in its simulation", simulated.power, joints)


def _check(place: str, supply: Float, joints: Float) -> None:
    """``supply``, ``joints``: power of the supply and of all joints together, (N,) W."""
    if np.std(joints) < ENOUGH or np.std(supply) == 0:
        return
    slope = float(np.cov(joints, supply)[0, 1] / np.var(joints))
    alike = float(np.corrcoef(joints, supply)[0, 1]) > ALIKE
    mean = float(joints.mean())
    low = abs(supply.mean()) < LEAST * mean and np.abs(supply).max() < LEAST * np.abs(joints).max()
    if (mean > ENOUGH and low) or (alike and slope < 1 / HUNDRED):
        raise RecordingError(
            f"{place}: power is {supply.mean():.3g} on average while the joints take {mean:.3g} W and up to "
            f"{joints.max():.3g} W: is it in kW? It must be in W"
        )
    if supply.mean() < -ENOUGH and mean > 0:
        raise RecordingError(
            f"{place}: power is {supply.mean():.3g} W on average, as if the arm supplied it: is its sign swapped?"
        )
    if alike and slope > HUNDRED:
        raise RecordingError(
            f"{place}: power changes {number(slope, 2)} times as much as the power of the joints: is it in mW? "
            "It must be in W"
        )
