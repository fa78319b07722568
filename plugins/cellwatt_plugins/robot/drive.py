"""Drives and the supply that they share: electrical power from torque and velocity.

Each joint's drive takes from the bus its mechanical power τ q̇, copper loss R I², switching loss k |I|, and iron loss by
eddy currents k q̇² and by hysteresis k |q̇| (ECDP, III-D). The supply draws up · D for a bus power D above 0
and down · D below: 1/up is the converter's efficiency; down is 0 if a brake resistor dissipates all regenerated power,
and equals up if all of it is used again (Sabry et al., equation (13), without its absolute value).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.description import RobotDescription


@dataclass(frozen=True)
class Drives:
    """State of an arm's drives, (N, n) each: arrays, or tensors of a model file."""

    mechanical: Any
    """Torque times velocity, W."""
    copper: Any
    """Current squared times the described winding resistance, W."""
    qd: Any
    """rad/s."""
    current: Any
    """A."""

    @classmethod
    def of(cls, torque: Any, qd: Any, current: Any, resistance: Any) -> Drives:
        """Return the state for torque (Nm), velocity (rad/s) and current (A), (N, n) each; resistance (n,) Ω."""
        return cls(torque * qd, current * current * resistance, qd, current)


TERMS: Final[Mapping[str, Callable[[Drives], Any]]] = {
    "mechanical": lambda d: d.mechanical,
    "copper": lambda d: d.copper,
    "switching": lambda d: np.abs(d.current),
    "eddy": lambda d: d.qd * d.qd,
    "hysteresis": lambda d: np.abs(d.qd),
}
"""Power terms (N, n) of each drive, by cause; a coefficient of the joint times a term is W taken from the bus."""


def drawn(bus: Any, up: Any, down: Any) -> Any:
    """Return the power (W) that the supply draws for a bus power (W): ``up`` times it above 0, ``down`` below."""
    return up * np.maximum(bus, 0.0) + down * np.minimum(bus, 0.0)


def copper_gain(robot: RobotDescription) -> Float:
    """Return the heat of each winding at a torque of 1 Nm, (n,) W/Nm²: R / K²; 0 where either is unknown."""
    constant, resistance = robot.column("torque_constant"), robot.column("winding_resistance")
    return np.divide(resistance, constant**2, out=np.zeros_like(constant), where=constant > 0)


def copper_loss(robot: RobotDescription, torque: Float) -> Float:
    """Return the heat (N, n) W of the windings at ``torque`` (N, n) Nm: R (torque / torque constant)²."""
    return np.asarray(torque**2 * copper_gain(robot))


def drive_power(copper: Float, torque: Float, qd: Float) -> Float:
    """Return the power (N, n) W of the drives: mechanical power, and the heat ``copper`` (n,) W/Nm² of the windings."""
    return np.asarray(torque * qd + copper * torque**2)


def nominal_power(robot: RobotDescription, torque: Float, qd: Float) -> Float:
    """Return the described supply power (N,) W for ``torque`` (N, n) Nm and velocity ``qd`` (N, n) rad/s."""
    bus = drive_power(copper_gain(robot), torque, qd).sum(axis=1)
    return np.asarray(robot.standby_power + drawn(bus, 1.0 / robot.converter_efficiency, robot.regeneration))
