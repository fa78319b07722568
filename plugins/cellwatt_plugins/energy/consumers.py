"""The equations of ECDP for the consumer groups of one repetition; W, J, s, percent."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]


def electronics_energy(controller: float, robot_electronics: float, seconds: float) -> float:
    """E_E = (P_RC + P_RE) T, J (eq. 14)."""
    return (controller + robot_electronics) * seconds


def brake_power(released: float, controller: float, robot_electronics: float, hold: float = 0.0) -> float:
    """P_MB = P_R − P_RC − P_RE, W (eq. 16), less what the motors need to ``hold`` the arm where G(q) is not zero."""
    return released - controller - robot_electronics - hold


def brake_energy(brakes: float, seconds: float) -> float:
    """E_MB = T P_MB, J (eq. 19)."""
    return brakes * seconds


def mechanical_power(torque: Float, velocity: Float) -> Float:
    """τ_i θ̇_i of each joint, (N, n) W (in eq. 2)."""
    return torque * velocity


def mechanical_losses(torque: Float, velocity: Float, step: float, stored: float = 0.0) -> float:
    """L_M = Σ ∫ τ_i θ̇_i dt − ΔE_K − ΔE_P, J (eqs 2, 18); ``stored`` is ΔE_K + ΔE_P, 0 J on a closed path."""
    return float(mechanical_power(torque, velocity).sum() * step - stored)


def positive_mechanical_energy(torque: Float, velocity: Float, step: float) -> float:
    """E_M+ = Σ ∫ P_i+ dt, J (eqs 4, 5): what the source must give, braking not counted."""
    return float(np.maximum(mechanical_power(torque, velocity), 0.0).sum() * step)


def negative_mechanical_energy(torque: Float, velocity: Float, step: float) -> float:
    """Σ ∫ P_i− dt, J (eqs 10, 11): the paper's estimate of E_RB, an upper bound of what reaches the chopper."""
    return float(np.maximum(-mechanical_power(torque, velocity), 0.0).sum() * step)


def electrical_losses(total: float, electronics: float, brakes: float, mechanical: float, stored: float = 0.0) -> float:
    """L_E* = E_R − E_E − E_MB − L_M (− ΔE), J (eqs 9, 12, 13): electrical losses with what the chopper burns."""
    return total - electronics - brakes - mechanical - stored


def motion_efficiency(positive: float, total: float) -> float:
    """ε_M+ = E_M+ / E_R, percent (eq. 17)."""
    return 100.0 * positive / total


def payload_energy(loaded: float, unloaded: float) -> float:
    """E_P = E_RL − E_RNL, J (eq. 20)."""
    return loaded - unloaded


def payload_efficiency(loaded: float, unloaded: float) -> float:
    """ε_P = (E_RL − E_RNL) / E_RL, percent (eq. 21)."""
    return 100.0 * payload_energy(loaded, unloaded) / loaded


def mean_power_shares(energies: Float, seconds: Float) -> Float:
    """Percent (k,) of each group in the mean power of some runs, from their energies (R, k) J and lengths (R,) s.

    The groups are all there is. Each run counts alike, however long it took: Fig. 6 and 8, and the averages that
    the paper gives over its robots.
    """
    power = np.mean(energies / seconds[:, None], axis=0)
    return np.asarray(100.0 * power / power.sum())


def friction_torque(velocity: Float, viscous: float, coulomb: float, offset: float, windage: float) -> Float:
    """τ_r = f_v θ̇ + f_c sign θ̇ + f_o + f_w θ̇² sign θ̇, (N,) Nm (eq. 7; windage against the motion)."""
    sign = np.sign(velocity)
    return np.asarray(viscous * velocity + coulomb * sign + offset + windage * velocity**2 * sign)
