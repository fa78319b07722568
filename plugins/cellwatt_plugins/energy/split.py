"""Energies of one run's repetitions, group by group, for given parameters of the drive."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.energy.clock import windows
from cellwatt_plugins.energy.drive import Drive, bus_power, chopper_power
from cellwatt_plugins.energy.identify import Observed, modelled, residual
from cellwatt_plugins.energy.repetitions import Repetition
from cellwatt_plugins.robot.accumulate import Accumulated

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Mechanical:
    """Energies (R,) J, one a repetition, that do not depend on the analyzer's reading."""

    losses: Float
    """L_M by joint, (R, n)."""
    positive: Float
    """E_M+."""
    negative: Float
    """Negative mechanical energy: what eq. 11 takes for E_RB."""
    regeneration: Float
    """Burnt in the chopper."""


def edges(repetitions: Sequence[Repetition]) -> tuple[Float, Float]:
    """Beginnings and ends (R,) s, robot's clock."""
    return np.array([r.start for r in repetitions]), np.array([r.end for r in repetitions])


def mechanical(one: Observed, drive: Drive, repetitions: Sequence[Repetition]) -> Mechanical:
    """Mechanical groups and regeneration of each repetition (eqs 4, 5, 10, 11, 18)."""
    n = len(drive.torque)
    power = one.feature[:, :n] * drive.torque
    chopper = chopper_power(drive, bus_power(drive, one.feature))
    columns = np.column_stack([power, np.maximum(power, 0.0).sum(axis=1), np.maximum(-power, 0.0).sum(axis=1), chopper])
    motion = one.run.motion
    energy = Accumulated(float(motion.time[0]), motion.step, columns).between(*edges(repetitions))
    return Mechanical(energy[:, :n], energy[:, n], energy[:, n + 1], energy[:, n + 2])


def total_energy(one: Observed, drive: Drive, repetitions: Sequence[Repetition]) -> Float:
    """Measured energy (R,) J of each repetition.

    The analyzer's values do not begin and end with the repetitions: within a value the model says how its energy
    is spread, and what the model misses of the value is spread evenly.
    """
    starts, ends = edges(repetitions)
    used, missed = residual(one, drive)
    low, high = (edge[used] for edge in windows(one.run.reading, one.offset.seconds))
    shared = np.minimum(high, ends[:, None]) - np.maximum(low, starts[:, None])
    spread = np.maximum(shared, 0.0) @ missed
    return np.asarray(modelled(one.run, one.feature, drive).between(starts, ends) + spread)
