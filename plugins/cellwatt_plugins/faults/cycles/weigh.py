"""Evaluates the evidence of a few effects together, with the full, nonlinear power of their torques.

Power is not linear in torque: copper loss grows with its square, and the supply's gain changes where the drives begin
to return power. Power is therefore linearised at the sizes found, and the sizes are fitted again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.faults.cycles.arm import Parameters
from cellwatt_plugins.faults.cycles.effects import Effect
from cellwatt_plugins.faults.cycles.load import Load, unsure_friction
from cellwatt_plugins.robot.regression import Fit, Prior, Products, Whitener

ROUNDS = 5
SETTLED = 0.02
"""The fit ends after this many rounds, or when the sizes change by less than this share."""
EFFECT_DOUBT = 0.03
COPPER_DOUBT = 0.15
"""Model error as a share of a fault's power, and of its copper loss (one sigma)."""


@dataclass(frozen=True)
class Weighed:
    """Effects fitted together: ``gain``, the log evidence relative to no effect; ``sizes`` of each; ``misfit``, the sum
    of squared residuals in standard deviations."""

    gain: float
    sizes: tuple[Float, ...]
    misfit: float


@dataclass(frozen=True)
class Bent:
    """``power`` (N,) W of effects at given sizes, ``slope`` (N, k) W per size, its uncertainty ``doubt`` (N, d) W."""

    power: Float
    slope: Float
    doubt: Float


def weigh(parameters: Parameters, load: Load, white: Whitener, residual: Float, effects: Sequence[Effect]) -> Weighed:
    """Fit effects to a white residual (N,)."""
    widths = [effect.columns.shape[1] for effect in effects]
    cuts: list[int] = np.cumsum(widths)[:-1].tolist()
    sizes = tuple(np.zeros(width) for width in widths)
    count = sum(widths)
    gain = misfit = 0.0
    for _ in range(ROUNDS):
        bent = bend(parameters, load, effects, sizes)
        columns = white(np.column_stack([bent.slope, bent.doubt]))
        flat = residual - white(bent.power) + columns[:, :count] @ np.concatenate(sizes)
        found = fit(Products.of(columns, flat))
        gain = found.evidence + 0.5 * float(residual @ residual - flat @ flat)
        rest = flat - columns @ found.coefficients
        misfit = float(rest @ rest)
        moved = float(np.abs(found.coefficients[:count] - np.concatenate(sizes)).max())
        sizes = tuple(np.split(found.coefficients[:count], cuts))
        if moved < SETTLED * float(np.abs(found.coefficients[:count]).max()):
            break
    return Weighed(gain, sizes, misfit)


def fit(products: Products) -> Fit:
    """Fit columns with unit priors: each column is scaled to one sigma of its size."""
    return Fit(products, Prior.spread(np.ones(len(products.pull))))


def bend(parameters: Parameters, load: Load, effects: Sequence[Effect], sizes: Sequence[Float]) -> Bent:
    """Nonlinear power of effects of these sizes, with its slope and uncertainty."""
    before = load.drives.sum(axis=1)
    more, slopes, doubts = np.zeros(len(before)), [], [np.empty((len(before), 0))]
    # A load of the supply takes its power beside the drives, whatever these take or return.
    beside = [effect.what == "switched" for effect in effects]
    for effect, size, apart in zip(effects, sizes, beside, strict=True):
        slope = effect.columns / load.gain[:, None]
        more += 0.0 if apart else slope @ size
        if effect.joint is not None and effect.torque is not None:
            extra, copper = effect.torque @ size, parameters.copper[effect.joint]
            more += copper * extra**2
            slope = slope + 2 * copper * extra[:, None] * effect.torque
            if extra.any():
                doubts.append(load.gain[:, None] * _doubt(load, effect.what, effect.joint, extra, copper))
        slopes.append(slope)
    after = before + more
    gain = np.where(after > 0, parameters.drive, parameters.regenerate)
    power = gain * after - load.gain * before
    power += sum(effect.columns @ size for effect, size, apart in zip(effects, sizes, beside, strict=True) if apart)
    bent = [(load.gain if apart else gain)[:, None] * slope for slope, apart in zip(slopes, beside, strict=True)]
    return Bent(power, np.column_stack(bent), np.column_stack(doubts))


def _doubt(load: Load, what: str, joint: int, extra: Float, copper: float) -> Float:
    """Uncertainty (N, d) W, at the drives, of the power of a torque ``extra`` (N,) Nm; one sigma per column."""
    speed, torque = load.motion.qd[:, joint], load.torque[:, joint]
    losses = copper * (2 * torque + extra) * extra
    columns = [EFFECT_DOUBT * (speed * extra + losses), COPPER_DOUBT * losses]
    if what == "friction":
        lever = speed + 2 * copper * torque + copper * extra
        columns += [*(lever[:, None] * unsure_friction(load, joint, extra)).T]
    return np.column_stack(columns)
