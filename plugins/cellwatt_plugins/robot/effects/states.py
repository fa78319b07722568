"""States of the arm along one run that an effect may depend on; no measured torque or power."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from cellwatt.arrays import Float
from cellwatt_plugins.robot.arm import Arm
from cellwatt_plugins.robot.description import RobotDescription
from cellwatt_plugins.robot.drive import nominal_power
from cellwatt_plugins.robot.motion import Moved, Turning
from cellwatt_plugins.robot.samples import Even

if TYPE_CHECKING:
    from cellwatt_plugins.robot.servo.law import Drive


REST = 0.3
"""Time in s without motion from which a joint is at rest."""
MOVING = 0.002
"""Velocity in rad/s from which a joint counts as moving."""


@dataclass(frozen=True)
class States(Even):
    """The arm along one run: N samples, n joints; everything that an effect's torque or power is computed from."""

    name: str
    """The run's name."""
    index: int
    """Its index among the explained runs; -1 for a motion that is only predicted."""
    time: Float
    """(N,) s."""
    moved: Moved
    arm: Arm
    temperature: Float | None = None
    """(N, n) °C where recorded."""
    beyond: Float | None = None
    """Torque (N, n) Nm of the simulation beyond the description's law."""
    beyond_power: Float | None = None
    """Supply power (N,) W of the simulation beyond the description's law."""
    fitted: Float | None = None
    """Motor torque (N, n) Nm of the current model; None before the first fit."""
    carried: Float | None = None
    """Torque (N, n) Nm that the links need beyond the nominal, in the current model."""
    exact_times: bool = True
    """False if the times of samples were estimated."""
    drive: Drive | None = None
    """The servos, if their law replaces a measured torque."""

    @property
    def servos(self) -> Drive:
        """The servos of an arm that is known by its motion alone."""
        assert self.drive is not None
        return self.drive

    @property
    def robot(self) -> RobotDescription:
        """The description of the arm."""
        return self.arm.description

    @property
    def q(self) -> Float:
        """Position (N, n) rad."""
        return self.moved.position

    @property
    def qd(self) -> Float:
        """Velocity (N, n) rad/s."""
        return self.moved.velocity

    @property
    def qdd(self) -> Float:
        """Acceleration (N, n) rad/s²."""
        return self.moved.acceleration

    @cached_property
    def motors(self) -> States:
        """The same run with the motion of the motors in place of the joints'; what the links need is unchanged."""
        if self.arm.coupling is None:
            return self
        new = replace(self, moved=self.moved.through(self.arm.coupling), arm=replace(self.arm, coupling=None))
        new.__dict__.update({name: getattr(self, name) for name in ("regressor", "rigid", "own_inertia")})
        return new

    @cached_property
    def turning(self) -> Turning:
        """Sign of friction along the motion."""
        return self.moved.turning(self.robot.friction_lead)

    @property
    def sign(self) -> Float:
        """Expected sign of friction (N, n), smooth within 4 mrad/s."""
        return self.turning.sign

    @cached_property
    def regressor(self) -> Float:
        """Inertial regressor (N, n, 10 n)."""
        return self.arm.body.regressor(self.q, self.qd, self.qdd)

    @cached_property
    def rigid(self) -> Float:
        """Torque (N, n) Nm of the nominal rigid body: what the links need."""
        return self.regressor @ self.arm.body.parameters()

    @property
    def unplanned(self) -> bool:
        """True if the motion was differentiated from encoders alone."""
        return not self.moved.planned

    @property
    def load(self) -> Float:
        """Torque (N, n) Nm that the links and their load need, in the current model."""
        return self.rigid if self.carried is None else self.rigid + self.carried

    @cached_property
    def own_inertia(self) -> Float:
        """Diagonal of the mass matrix (N, n) kg m²."""
        return np.diagonal(self.arm.body.mass_matrix(self.q), axis1=1, axis2=2)

    @cached_property
    def friction(self) -> Float:
        """Nominal friction torque (N, n) Nm."""
        turned = self.motors
        coulomb = self.arm.column("coulomb_friction") * turned.sign
        return self.arm.of_motors(coulomb + self.arm.column("viscous_friction") * turned.qd)

    @property
    def motors_law(self) -> Float:
        """Nominal torque (N, n) Nm of the rotors and of friction."""
        return self.friction + self.arm.of_motors(self.arm.column("rotor_inertia") * self.motors.qdd)

    @cached_property
    def nominal(self) -> Float:
        """Motor torque (N, n) Nm of the simulation."""
        law = self.rigid + self.motors_law
        return law if self.beyond is None else law + self.beyond

    @property
    def nominal_power(self) -> Float:
        """Supply power (N,) W of the simulation, at the motor torque of the current model."""
        law = nominal_power(self.arm.description, self.torque, self.qd)
        return law if self.beyond_power is None else law + self.beyond_power

    @property
    def torque(self) -> Float:
        """Motor torque (N, n) Nm of the current model."""
        return self.nominal if self.fitted is None else self.fitted

    @cached_property
    def resting(self) -> NDArray[np.bool_]:
        """(N, n) true where a joint is at rest."""
        still = np.abs(self.qd) < MOVING
        return np.asarray(minimum_filter1d(still, max(1, round(REST / self.step)), axis=0))

    @cached_property
    def moving(self) -> NDArray[np.bool_]:
        """(N,) true while any joint moves."""
        return np.asarray(np.any(np.abs(self.qd) > MOVING, axis=1))

    def with_torque(self, torque: Float, carried: Float | None = None) -> States:
        """The same run with another fitted torque (and load, if given); cached values are shared."""
        new = replace(self, fitted=torque, carried=self.carried if carried is None else carried)
        for name in ("regressor", "rigid", "own_inertia", "friction", "nominal", "moving", "turning", "resting"):
            if name in self.__dict__:
                new.__dict__[name] = self.__dict__[name]
        return new
