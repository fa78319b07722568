"""Step 1 of ECDP: the power that does not depend on the motion, from measurements at rest."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cellwatt_plugins.energy.recordings import PowerTrace

BLOCKS = 10
"""Number of blocks; their means separate noise, which averages out, from drift, which does not."""
DRIFT = 0.2
"""Largest trend of steady power over the measurement, W …"""
SIGMAS = 4.0
"""… or, if larger, in standard errors of the trend."""


@dataclass(frozen=True)
class Steady:
    """Mean power of one state at rest, W, with one standard deviation of the mean.

    ``drift`` W is the change of a straight-line fit from the beginning to the end, ``noise`` W that of one value.
    """

    power: float
    uncertainty: float
    drift: float
    noise: float
    steady: bool


def steady_power(reading: PowerTrace) -> Steady:
    """Mean power at rest, its uncertainty from the scatter of block means, and whether it is steady."""
    power = reading.power
    blocks = np.array([block.mean() for block in np.array_split(power, min(BLOCKS, len(power)))])
    x = np.linspace(-0.5, 0.5, len(power))
    drift = float(x @ power / (x @ x))
    error = float(np.std(power - drift * x - power.mean()) / np.sqrt(x @ x))
    uncertainty = max(float(blocks.std(ddof=1)), float(power.std(ddof=1)) * np.sqrt(len(blocks) / len(power)))
    noise = float(np.std(np.diff(power))) / np.sqrt(2.0)
    unsteady = abs(drift) > max(DRIFT, SIGMAS * error)
    spread = abs(drift) / np.sqrt(12) if unsteady else 0.0
    return Steady(
        float(power.mean()), float(np.hypot(uncertainty / np.sqrt(len(blocks)), spread)), drift, noise, not unsteady
    )


@dataclass(frozen=True)
class AtRest:
    """Power in the three states of step 1."""

    controller: Steady
    connected: Steady
    released: Steady

    def notes(self) -> list[str]:
        """A sentence on each state whose power was not steady."""
        names = ("controller", "connected", "released")
        return [
            f"{name}: not steady, drifted by {state.drift:+.2f} W: let it warm up and take it again"
            for name, state in zip(names, (self.controller, self.connected, self.released), strict=True)
            if not state.steady
        ]
