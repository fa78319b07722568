"""A recorded run on an even time grid, and its simulation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from cellwatt.arrays import Bool, Float
from cellwatt_plugins.robot.motion import Plan
from cellwatt_plugins.robot.samples import Even
from cellwatt_plugins.robot.servo.law import Drive


@dataclass(frozen=True)
class Simulated:
    """Torque and power of the user's simulation for the planned motion, at the simulation's own M times."""

    time: Float
    """(M,) s on the recording's clock."""
    plan: Plan
    """(M, n) each."""
    torque: Float
    """(M, n) Nm."""
    power: Float | None = None
    """(M,) W."""


@dataclass(frozen=True)
class Run(Even):
    """A recorded run of n joints: N samples, evenly spaced."""

    name: str
    """File name without its endings, e.g. ``run_01``."""
    time: Float
    """(N,) s, evenly spaced."""
    position: Float
    """(N, n) rad."""
    velocity: Float | None
    """(N, n) rad/s, where recorded."""
    torque: Float
    """(N, n) Nm, motor torque at the joint side; NaN, also in whole columns, where it was not recorded or not read."""
    power: Float | None = None
    """(N,) W of the supply, where recorded."""
    temperature: Float | None = None
    """(N, n) °C, where recorded."""
    command: Float | None = None
    """(N, n) rad, commanded positions, where recorded."""
    drive: Drive | None = None
    """Servos whose control law gives the torque if no torque was recorded."""
    plan: Plan | None = None
    simulated: Simulated | None = None
    """Simulation that the recording is compared with; None: the law in robot.yaml."""
    exact_times: bool = True
    """False if the times of samples were estimated from the positions."""
    gaps: Bool | None = None
    """(N,) true where samples were missing and values were filled in."""
    averaged: int = 1
    """Number of recorded samples of which each sample is the mean."""
    torque_from: Literal["torque", "current"] = "torque"
    """Recorded quantity; current is multiplied by the torque constants of the description."""
    notes: tuple[str, ...] = ()
    """Corrections made when the recording was read, one sentence each."""

    @property
    def filled(self) -> Bool:
        """(N,) true where samples were filled in; all false if ``gaps`` is None."""
        return np.zeros(len(self.time), np.bool_) if self.gaps is None else self.gaps

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return int(self.position.shape[1])
