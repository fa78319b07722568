"""What acts at the joints of the plant beside rigid bodies: friction, and loads on the motor.

All terms see (C, n) arrays: C copies of the arm that run side by side, one a recording, and n joints.
"""

from __future__ import annotations

from copy import deepcopy
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from concealed.arms import Arm, Array
from concealed.law import SIGN_WIDTH


@dataclass
class Moment:
    """The state that the terms of one tick see; `load` is the torque that the gear transmits to the link, Nm."""

    t: float
    dt: float
    q: Array
    v: Array
    sign: Array
    load: Array
    temperature: Array


class Friction(Protocol):
    """Adds to the friction torque (C, n), which opposes motion: positive for positive velocity."""

    def add(self, m: Moment, torque: Array) -> None: ...


class Load(Protocol):
    """Adds to the torque (C, n) that the motor has to supply on top of friction and rigid body."""

    def add(self, m: Moment, torque: Array) -> None: ...


@dataclass(frozen=True)
class AtJoint:
    """A friction or a load of one joint."""

    joint: int

    def add(self, m: Moment, torque: Array) -> None:
        torque[:, self.joint] += self.of(m, m.q[:, self.joint], m.v[:, self.joint], m.sign[:, self.joint])

    def of(self, m: Moment, q: Array, v: Array, sign: Array) -> Array:
        """Torque (C,) of the joint at its position, velocity and sign of the velocity."""
        raise NotImplementedError


@dataclass(frozen=True)
class Stribeck(AtJoint):
    """excess · exp(-(v / velocity)²) · sign(v)."""

    excess: float
    velocity: float

    def of(self, m: Moment, q: Array, v: Array, sign: Array) -> Array:
        return np.asarray(self.excess * np.exp(-((v / self.velocity) ** 2)) * sign)


@dataclass(frozen=True)
class LoadFriction(AtJoint):
    """coefficient · |torque through the gear| · sign(v)."""

    coefficient: float

    def of(self, m: Moment, q: Array, v: Array, sign: Array) -> Array:
        return np.asarray(self.coefficient * np.abs(m.load[:, self.joint]) * sign)


@dataclass(frozen=True)
class Asymmetry(AtJoint):
    """Coulomb friction larger by difference/2 forward and smaller by it backward."""

    difference: float

    def of(self, m: Moment, q: Array, v: Array, sign: Array) -> Array:
        return np.asarray(0.5 * self.difference * np.abs(sign))


@dataclass(frozen=True)
class PowerLaw(AtJoint):
    """coefficient · |v|^exponent · sign(v)."""

    coefficient: float
    exponent: float

    def of(self, m: Moment, q: Array, v: Array, sign: Array) -> Array:
        return np.asarray(self.coefficient * np.abs(v) ** self.exponent * np.sign(v))


@dataclass(frozen=True)
class Patch(AtJoint):
    """Extra Coulomb friction in the part of the range beyond `start` (rad)."""

    force: float
    start: float

    def of(self, m: Moment, q: Array, v: Array, sign: Array) -> Array:
        return np.asarray(self.force * sign * (q > self.start))


@dataclass(frozen=True)
class Warming(AtJoint):
    """Base friction times 1 + (cold_factor - 1) · exp(-(T - cold) / scale): larger in a cold gear."""

    coulomb: float
    viscous: float
    cold_factor: float
    scale: float
    cold: float

    def of(self, m: Moment, q: Array, v: Array, sign: Array) -> Array:
        share = (self.cold_factor - 1.0) * np.exp(-(m.temperature[:, self.joint] - self.cold) / self.scale)
        return np.asarray(share * (self.coulomb * sign + self.viscous * v))


@dataclass
class Dahl:
    """Friction `force` that builds up over `displacement` (rad) after a reversal (Dahl 1968); it can also push."""

    joint: int
    force: float
    displacement: float
    bristle: Array | None = None
    last: Array | None = None

    def add(self, m: Moment, torque: Array) -> None:
        q = m.q[:, self.joint]
        if self.bristle is None or self.last is None:
            self.bristle, self.last = np.zeros(len(q)), q.copy()
        step = q - self.last
        towards = np.sign(step)
        self.bristle = towards + (self.bristle - towards) * np.exp(-np.abs(step) / self.displacement)
        self.last = q.copy()
        torque[:, self.joint] += self.force * self.bristle


@dataclass(frozen=True)
class Spring(AtJoint):
    """stiffness · (q - rest): balancer, hose or cable."""

    stiffness: float
    rest: float

    def of(self, m: Moment, q: Array, v: Array, sign: Array) -> Array:
        return np.asarray(self.stiffness * (q - self.rest))


@dataclass(frozen=True)
class Cogging(AtJoint):
    """amplitude · sin(cycles · q + phase)."""

    amplitude: float
    cycles: float
    phase: float

    def of(self, m: Moment, q: Array, v: Array, sign: Array) -> Array:
        return np.asarray(self.amplitude * np.sin(self.cycles * q + self.phase))


@dataclass(frozen=True)
class Push:
    """A half-sine push against one motor, in one copy, around `time` for `width` s."""

    joint: int
    copy: int
    time: float
    width: float
    torque: float

    def add(self, m: Moment, torque: Array) -> None:
        u = (m.t - self.time) / self.width + 0.5
        if 0.0 < u < 1.0:
            torque[self.copy, self.joint] += self.torque * np.sin(np.pi * u)


@dataclass(frozen=True)
class Shaking(AtJoint):
    """A tone of `hertz` while the position is within `width` of `where`."""

    amplitude: float
    hertz: float
    where: float
    width: float

    def of(self, m: Moment, q: Array, v: Array, sign: Array) -> Array:
        near = np.exp(-(((q - self.where) / self.width) ** 4))
        return np.asarray(self.amplitude * np.sin(2 * np.pi * self.hertz * m.t) * near)


@dataclass(frozen=True)
class Howling(AtJoint):
    """A tone of `hertz` while the speed is in a band around `speed` (a resonance of the drive)."""

    amplitude: float
    hertz: float
    speed: float
    band: float

    def of(self, m: Moment, q: Array, v: Array, sign: Array) -> Array:
        inside = np.exp(-(((np.abs(v) - self.speed) / self.band) ** 2))
        return np.asarray(self.amplitude * np.sin(2 * np.pi * self.hertz * m.t) * inside)


@dataclass(frozen=True)
class Knock:
    """A pulse of `width` s once every `period` s, whatever the arm does."""

    joint: int
    torque: float
    period: float
    width: float
    phase: float

    def add(self, m: Moment, torque: Array) -> None:
        if (m.t - self.phase) % self.period < self.width:
            torque[:, self.joint] += self.torque


@dataclass(frozen=True)
class Heat:
    """First-order warming of each joint above `ambient` °C by its own losses: (n,) K/W and s."""

    resistance: Array
    time_constant: Array
    ambient: float

    def step(self, temperature: Array, loss: Array, dt: float) -> None:
        """Advance (C, n) temperatures by dt under (C, n) losses in W, in place."""
        temperature += dt / self.time_constant * (self.ambient + self.resistance * loss - temperature)


@dataclass
class Joints:
    """Friction and loads of all joints, with what the terms add to plain Coulomb and viscous friction."""

    coulomb: Array
    viscous: Array
    frictions: list[Friction] = field(default_factory=list)
    loads: list[Load] = field(default_factory=list)
    heat: Heat | None = None

    @classmethod
    def of(cls, arm: Arm) -> Joints:
        """Plain friction of the arm."""
        return cls(arm.coulomb, arm.viscous)

    def friction(self, m: Moment) -> Array:
        """(C, n) friction torque."""
        torque: Array = self.coulomb * m.sign + self.viscous * m.v
        for term in self.frictions:
            term.add(m, torque)
        return torque

    def load(self, m: Moment) -> Array:
        """(C, n) further torque for the motor."""
        torque = np.zeros_like(m.v)
        for term in self.loads:
            term.add(m, torque)
        return torque


def playback(arm: Arm, joints: Joints, q: Array, v: Array, rigid: Array, t: Array) -> Array:
    """(N, C, n) friction and loads when the motion (N, C, n) is followed exactly at times t (N,).

    `rigid` is the links' torque.
    The same terms as in the plant, without its dynamics: to size effects before, and as the best possible
    prediction from a planned motion after.
    """
    joints = deepcopy(joints)  # terms with a state start afresh
    dt = float(t[1] - t[0])
    out = np.empty_like(q)
    sign = np.tanh(v / SIGN_WIDTH)
    warm = np.full(q.shape[1:], joints.heat.ambient if joints.heat else 25.0)
    for i in range(len(q)):
        m = Moment(float(t[i]), dt, q[i], v[i], sign[i], rigid[i], warm)
        friction = joints.friction(m)
        out[i] = friction + joints.load(m)
        if joints.heat:
            copper = arm.resistance * ((rigid[i] + out[i]) / arm.constant) ** 2
            joints.heat.step(warm, friction * v[i] + copper, dt)
    return out
