"""The equations of ECDP for the consumer groups of one repetition; W, J, s, percent."""

from __future__ import annotations

import numpy as np

from cellwatt.arrays import Float


def brake_power(released: float, controller: float, robot_electronics: float, hold: float = 0.0) -> float:
    """P_MB = P_R − P_RC − P_RE, W (eq. 16), minus the power with which motors ``hold`` the arm if G(q) is not zero."""
    return released - controller - robot_electronics - hold


def electrical_losses(total: float, electronics: float, brakes: float, mechanical: float) -> float:
    """L_E* = E_R − E_E − E_MB − L_M, J (eqs 9, 12, 13): electrical losses including the chopper, of a closed path."""
    return total - electronics - brakes - mechanical


def motion_efficiency(positive: float, total: float) -> float:
    """ε_M+ = E_M+ / E_R, percent (eq. 17)."""
    return 100.0 * positive / total


def payload_efficiency(loaded: float, unloaded: float) -> float:
    """ε_P = E_P / E_RL, percent (eq. 21), with the payload's energy E_P = E_RL − E_RNL (eq. 20)."""
    return 100.0 * (loaded - unloaded) / loaded


def mean_power_shares(energies: Float, seconds: Float) -> Float:
    """Share (k,) of each group in the mean power of runs, percent, from their energies (R, k) J and durations (R,) s.

    The groups add up to the total. Each run has the same weight whatever its duration, as in Figs 6 and 8 and the
    paper's averages over robots.
    """
    power = np.mean(energies / seconds[:, None], axis=0)
    return np.asarray(100.0 * power / power.sum())
