"""Findings of ``disaggregate``; every field is a key of ``energy.json``."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from typing import Any


@dataclass(frozen=True)
class Fixed:
    """Table II: power that does not depend on the motion, W, with one standard deviation each.

    ``hold`` is the power of the motors in the third state, where they hold the arm because G(q) is not exactly zero.
    """

    controller: float
    robot_electronics: float
    brakes: float
    controller_uncertainty: float
    robot_electronics_uncertainty: float
    brakes_uncertainty: float
    hold: float
    notes: tuple[str, ...] = ()

    @property
    def electronics(self) -> float:
        """P_E = P_RC + P_RE."""
        return self.controller + self.robot_electronics


@dataclass(frozen=True)
class JointFriction:
    """Friction of one joint by eq. (7), at the joint side.

    ``viscous`` Nm s/rad, ``coulomb`` and ``offset`` Nm, ``windage`` Nm s²/rad²; ``further`` holds the coefficients of
    the other friction laws fitted.
    """

    joint: str
    viscous: float
    coulomb: float
    offset: float
    windage: float
    further: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class JointDrive:
    """Identified parameters of one joint's drive.

    The torque reported by the robot is the true torque times ``torque_gain``. ``winding_resistance`` Ω is at the
    described torque constant; ``switching`` W/A, ``iron`` W s²/rad² (eddy currents), ``hysteresis`` W s/rad.
    """

    joint: str
    torque_gain: float
    torque_gain_uncertainty: float
    winding_resistance: float
    switching: float
    iron: float
    hysteresis: float


@dataclass(frozen=True)
class RunEnergy:
    """Table III: energies of one run, means over its repetitions, J, with one standard deviation each.

    ``regeneration_upper_bound`` is the negative mechanical energy (eq. 11), ``path_speed_mm_s`` the mean speed of the
    flange along the path, from the encoders.
    """

    run: str
    speed_mm_s: float
    payload_kg: float
    repetitions: int
    seconds: float
    total: float
    electronics: float
    brakes: float
    mechanical_losses: float
    electrical_losses_with_regeneration: float
    electrical_losses: float | None
    regeneration: float | None
    regeneration_upper_bound: float
    positive_mechanical: float
    motion_efficiency_percent: float
    analyzer_offset_s: float
    path_speed_mm_s: float
    uncertainty: Mapping[str, float | None] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def split(self) -> tuple[float | None, ...]:
        """Energies of electronics, brakes, friction, motors and drives, chopper; None: part of the one before it."""
        electrical = self.electrical_losses_with_regeneration if self.regeneration is None else self.electrical_losses
        return self.electronics, self.brakes, self.mechanical_losses, electrical, self.regeneration


@dataclass(frozen=True)
class Findings:
    """Findings of a whole campaign."""

    robot: str
    fixed: Fixed
    runs: tuple[RunEnergy, ...]
    payload_efficiency_percent: Mapping[str, float]
    """ε_P (eq. 21) by speed in mm/s."""
    average_share_percent: Mapping[str, float]
    """Share of each group in the mean power of all runs (Fig. 8)."""
    drives: tuple[JointDrive, ...]
    friction: tuple[JointFriction, ...]
    returned: float
    """Share of the braking power on the bus that the electronics used; the chopper burnt the rest."""
    returned_uncertainty: float
    model_error_percent: float
    """Difference between modelled and measured energy of a repetition, rms over the runs."""
    notes: tuple[str, ...] = ()
    covariance: tuple[tuple[float, ...], ...] = field(kw_only=True)
    """Covariance (2 + 5 n, 2 + 5 n) in the units of ``Drive``: fixed power, then torque factor, copper, switching, iron
    and hysteresis, each for all joints, then ``returned``."""

    def as_json(self) -> dict[str, Any]:
        """The content of ``energy.json``."""
        return asdict(self)
