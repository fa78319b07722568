"""A robot arm as one object: its description and its rigid body, and the torque and power of a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import ConfigError
from cellwatt.files import Place
from cellwatt_plugins.robot.body import Body
from cellwatt_plugins.robot.description import RobotDescription, load_robot
from cellwatt_plugins.robot.drive import nominal_power
from cellwatt_plugins.robot.motion import direction
from cellwatt_plugins.robot.simulated import described, is_simulator
from cellwatt_plugins.robot.units import Kind, unit_at


@dataclass(frozen=True)
class Arm:
    """An arm with n ``joints`` as its description has it: links, rotors, friction, drives and supply.

    Arrays have one row a sample and one column a joint: ``q`` rad, ``qd`` rad/s, ``qdd`` rad/s², (N, n) each. Torques
    are those of the motors at the joint side. The term of a number that the description lacks is 0.

        arm = Arm.load("mh12")
        torque = arm.torque(q, qd, qdd)
    """

    description: RobotDescription
    body: Body
    coupling: Float | None = None
    """Turns (n, n) of each motor, a row each, per turn of each joint; None if each joint has a motor of its own."""

    @classmethod
    def load(cls, robot: Place, needs: Sequence[str] = (), weighed: bool = True) -> Arm:
        """Read an arm: a packaged robot's name (``"mh12"``), a ``robot.yaml`` or its folder, or an MJCF or URDF alone.

        ``needs`` are keys that every joint must have above 0, such as ``torque_constant``; ``weighed``: links must have
        masses.

        Raises ``ConfigError`` with the file and the key if the description or the URDF cannot be used.
        """
        path = Path(robot)
        if not is_simulator(path):
            return cls.of(load_robot(robot, needs), weighed)
        if needs:
            raise ConfigError(f"{path} has no {needs[0]}: write a robot.yaml that has it, with this file as its urdf")
        return cls.of(described(path), weighed)

    @classmethod
    def of(cls, description: RobotDescription, weighed: bool = True) -> Arm:
        """The arm of a description, with its joints' kinds from the URDF.

        Raises ``ConfigError`` if the URDF cannot be read, has other joints, joints of other kinds, or, if ``weighed``,
        links without mass.
        """
        body = Body(description.urdf, description.names)
        body = body.with_gravity(np.array(description.gravity))
        if weighed and (missing := body.without_mass()):
            raise ConfigError(
                f"{description.urdf}: no mass of {', '.join(missing)}: without it the arm's weight and inertia are "
                "unknown: write <inertial> into these links, from CAD or the maker's data"
            )
        return cls(_with_kinds(description, body), body)

    @property
    def name(self) -> str:
        """The robot's name in its description."""
        return self.description.robot

    @property
    def joints(self) -> int:
        """Number of joints, n."""
        return len(self.description.joints)

    @property
    def limits(self) -> Float:
        """Lowest and highest position (n, 2) rad of each joint: the description's, else the URDF's."""
        stated = self.description.limits
        return np.where(np.isnan(stated), self.body.limits, stated)

    @property
    def velocity_limits(self) -> Float:
        """Greatest velocity (n,) rad/s of each joint: the description's, else the URDF's; 0 if neither has one."""
        stated = self.column("velocity_limit")
        found = np.where(np.isnan(stated), self.body.velocity_limits, stated)
        return np.where(np.isfinite(found), found, 0.0)

    def finite_limits(self) -> Float:
        """``limits`` if every joint has a range. Raises ``ConfigError`` with the first joint without one."""
        limits = self.limits
        for joint, pair in zip(self.description.joints, limits, strict=True):
            if not (np.isfinite(pair).all() and pair[0] < pair[1]):
                raise ConfigError(
                    f"{self.description.urdf}: {joint.name} has no range: write lower_limit and upper_limit, in "
                    f"{unit_at(joint.kind, 'rad')}"
                )
        return limits

    def column(self, name: str) -> Float:
        """One number of every joint's description, e.g. ``winding_resistance``: (n,), in the unit of that key."""
        return self.description.column(name)

    def with_parameters(self, parameters: Float) -> Arm:
        """The same arm with other inertial ``parameters`` (10 n,) of its links; see ``Body.parameters``."""
        return replace(self, body=self.body.with_parameters(parameters))

    def with_gravity(self, field: Float) -> Arm:
        """The same arm with gravity ``field`` (3,) m/s² in the base's frame."""
        return replace(self, body=self.body.with_gravity(field))

    def with_coupling(self, coupling: Float) -> Arm:
        """The same arm with other turns (n, n) of its motors per turn of each joint."""
        return replace(self, coupling=coupling)

    def coupled(self, joint: int | None) -> bool:
        """True if the motor of a joint (0-based) also turns with other joints."""
        return joint is not None and loads_several(self.coupling, joint)

    def at_motors(self, motion: Float) -> Float:
        """Angles, speeds or accelerations (N, n) of the motors, at the joint side, from those of the joints."""
        return motion if self.coupling is None else motion @ self.coupling.T

    def of_motors(self, torque: Float) -> Float:
        """Torque (N, n) Nm at the joints from that of the motors, at the joint side."""
        return torque if self.coupling is None else torque @ self.coupling

    def with_friction_lead(self, lead: float) -> Arm:
        """The same arm with Coulomb friction that reverses ``lead`` s before the velocity does."""
        return replace(self, description=self.description.model_copy(update={"friction_lead": lead}))

    def torque(self, q: Float, qd: Float, qdd: Float) -> Float:
        """Motor torques (N, n) Nm that a motion needs: links, rotors, Coulomb and viscous friction.

        Links by recursive Newton–Euler (``Body.inverse_dynamics``); friction F_c tanh(qd / 0.004) + F_v qd, the first
        with the velocity ``friction_lead`` s later.
        """
        speed, gain = self.at_motors(qd), self.at_motors(qdd)
        motors = self.column("coulomb_friction") * direction(speed + self.description.friction_lead * gain)
        motors += self.column("viscous_friction") * speed + self.column("rotor_inertia") * gain
        return np.asarray(self.body.inverse_dynamics(q, qd, qdd) + self.of_motors(motors))

    def power(self, q: Float, qd: Float, qdd: Float) -> Float:
        """Supply power (N,) W that a motion needs: standby, mechanical power and copper loss through the converter."""
        return nominal_power(self.description, self.torque(q, qd, qdd), qd)

    def gravity(self, q: Float) -> Float:
        """Torques (N, n) Nm that hold the links still at ``q`` (N, n) rad, without friction."""
        return self.body.gravity(q)

    def forward(self, q: Float) -> Float:
        """Frames (N, n, 4, 4) m of the joints in the base's frame at ``q`` (N, n) rad; the last one is the flange's."""
        return self.body.forward(q)


def loads_several(coupling: Float | None, joint: int) -> bool:
    """True if the motor of a joint (0-based) turns with several joints; ``coupling``: see ``Arm``."""
    return coupling is not None and int(np.count_nonzero(coupling[joint])) > 1


def _with_kinds(description: RobotDescription, body: Body) -> RobotDescription:
    kinds: list[Kind] = ["revolute" if turns else "prismatic" for turns in body.turns]
    for joint, kind in zip(description.joints, kinds, strict=True):
        if "kind" in joint.model_fields_set and joint.kind != kind:
            raise ConfigError(
                f"{description.urdf}: joint {joint.name} is {kind}, but {joint.kind} in the robot's description"
            )
    if all(kind == "revolute" for kind in kinds):
        return description
    joints = (joint.model_copy(update={"kind": kind}) for joint, kind in zip(description.joints, kinds, strict=True))
    return description.model_copy(update={"joints": tuple(joints)})
