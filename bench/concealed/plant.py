"""The plant: MuJoCo steps several copies of the arm at once, each under its own controller and on its own task."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace

import mujoco
import numpy as np

from concealed.arms import Arm, Array, mistune
from concealed.describe import mjcf
from concealed.law import SIGN_WIDTH, RigidBody
from concealed.mechanics import Joints, Knock, Moment, Push, playback
from concealed.motion import Plan

LEAD = 0.5
"""Seconds at rest before time zero, for the controller to settle."""
TAIL = 0.1
STILL = 1e-6
DAMPED = 0.7
"""Share of critical damping of a soft loop."""
MIDDLE = 0.25
"""Of a tick: in MuJoCo's semi-implicit steps of half a tick, velocities belong half a step before their positions."""


@dataclass(frozen=True)
class TwoMass:
    """Motor and link of one joint as two masses: spring Nm/rad, damper Nm s/rad, dead zone `gap` rad in all."""

    joint: int
    stiffness: float
    damping: float
    gap: float = 0.0

    def torque(self, twist: Array) -> Array:
        """Torque of the spring at a twist outside the dead zone."""
        return np.asarray(self.stiffness * (twist - np.clip(twist, -self.gap / 2, self.gap / 2)))


@dataclass(frozen=True)
class Grip:
    """A mass at the flange (kg, m in its frame); with a period it is held from `start` for `hold` s of each."""

    mass: float
    com: Array
    start: float = 0.0
    hold: float = np.inf
    period: float = np.inf

    def held(self, t: float) -> bool:
        """Whether the mass is at the flange at time t."""
        return t >= self.start and (t - self.start) % self.period < self.hold if np.isfinite(self.period) else True


@dataclass
class Body:
    """Everything mechanical of one case."""

    arm: Arm
    joints: Joints
    two_mass: TwoMass | None = None
    grip: Grip | None = None
    gravity: Array | None = None


@dataclass(frozen=True)
class Controller:
    """Joint PD, gains (n,) in Nm/rad and Nm s/rad, with the torque fed forward that a slightly wrong model expects."""

    model: Body
    stiffness: Array
    damping: Array


@dataclass
class Trace:
    """What really happened: (N, C, n) float32 motor motion, torque and temperature.

    The controller holds its torque for a tick; sample i, at t[i], is the middle of tick i as MuJoCo's velocities see
    it. Time zero is the plan's.
    """

    tick: float
    t: Array
    q: Array
    v: Array
    a: Array
    torque: Array
    temperature: Array | None = field(default=None)


def tune(rng: np.random.Generator, body: Body, tick: float, hertz: float | None = None) -> Controller:
    """A controller that has been set up for this arm as it stands: its own figures are off by a few per cent.

    It knows what it carries and what its joints feel like, except for what comes by the clock. The velocity loop is
    as fast as the tick allows, the position loop has 20 to 45 1/s. A loop of so many ``hertz`` is much softer: friction
    that it does not know holds the arm for a moment at each reversal, and motion leaves its plan.
    """
    arm, joints = mistune(rng, body.arm), body.joints
    share = np.where(body.arm.coulomb > 0, joints.coulomb / body.arm.coulomb, 1.0)
    loads = [x for x in joints.loads if not isinstance(x, (Push, Knock))]
    model = replace(
        body, arm=arm, joints=Joints(arm.coulomb * share, arm.viscous, joints.frictions, loads, joints.heat)
    )
    felt = body.arm.rotor + np.minimum(RigidBody(arm).inertia(0.5 * (arm.low + arm.high)), 1.5 * body.arm.rotor)
    damping = felt * 0.2 / tick * rng.uniform(0.6, 1.0)
    stiffness = damping * rng.uniform(20.0, 45.0)
    if hertz is None:
        return Controller(model, stiffness, damping)
    turns = 2 * np.pi * hertz
    return Controller(model, felt * turns**2, 2 * DAMPED * felt * turns)


def stack(plans: Sequence[Plan], what: str, lead: int, tail: int) -> Array:
    """(N, C, n) of one quantity of all plans, held at both ends and padded to the longest."""
    longest = max(len(p.q) for p in plans)
    rows = []
    for p in plans:
        x = getattr(p, what)
        before, after = np.tile(x[0], (lead, 1)), np.tile(x[-1], (longest - len(x) + tail, 1))
        rows.append(np.concatenate([before, x, after]))
    return np.stack(rows, axis=1)


def rigid_torque(body: Body, q: Array, v: Array, a: Array, t: Array) -> Array:
    """(N, C, n) torque of the links and of what they carry, for motion (N, C, n) at times t (N,)."""

    def of(model: RigidBody, rows: Array) -> Array:
        return np.stack([model.torque(q[rows, c], v[rows, c], a[rows, c]) for c in range(q.shape[1])], axis=1)

    held = np.array([body.grip is not None and body.grip.held(x) for x in t])
    out = np.empty_like(q)
    out[~held] = of(RigidBody(body.arm, gravity=body.gravity), ~held)
    if body.grip is not None:
        out[held] = of(RigidBody(body.arm, (body.grip.mass, body.grip.com), body.gravity), held)
    return out


def ideal(body: Body, q: Array, v: Array, a: Array, t: Array) -> Array:
    """(N, C, n) motor torque on a regular grid t if the body followed the motion exactly, as one mass a joint."""
    rigid = rigid_torque(body, q, v, a, t)
    return np.asarray(rigid + body.arm.rotor * a + playback(body.arm, body.joints, q, v, rigid, t))


def feed_forward(model: Body, q: Array, v: Array, a: Array, t: Array, every: float = 0.008) -> Array:
    """(N, C, n) torque that the controller's model expects: plain friction at each tick, the rest every few."""
    skip = max(1, round(every / (t[1] - t[0])))
    joints = model.joints
    smooth = replace(model, joints=replace(joints, coulomb=0.0 * joints.coulomb))
    coarse = ideal(smooth, q[::skip], v[::skip], a[::skip], t[::skip])
    out = joints.coulomb * np.tanh(v / SIGN_WIDTH)
    for c in range(q.shape[1]):
        for j in range(q.shape[2]):
            out[:, c, j] += np.interp(t, t[::skip], coarse[:, c, j])
    return out


def simulate(body: Body, plans: Sequence[Plan], control: Controller) -> Trace:
    """Run all plans side by side and return what the motors did."""
    tick = plans[0].tick
    lead, tail = round(LEAD / tick), round(TAIL / tick)
    q, v, a = (stack(plans, what, lead, tail) for what in "qva")
    wanted = feed_forward(control.model, q, v, a, np.arange(len(q)) * tick - LEAD)
    wanted[:-1] += MIDDLE * (wanted[1:] - wanted[:-1])  # it is held for a tick
    return Run(body, len(plans), tick).follow(q, v, wanted, control)


def steepness(friction: Array, m: Moment, viscous: Array) -> Array:
    """(C, n) slope of friction over velocity: what is not viscous rises like the smoothed sign."""
    dry = np.abs(friction - viscous * m.v) / np.maximum(np.abs(m.sign), 1e-4)
    return np.asarray(viscous + dry * (1.0 - m.sign**2) / SIGN_WIDTH)


class Run:
    """One MuJoCo model with its copies of the arm, between ticks."""

    def __init__(self, body: Body, copies: int, tick: float) -> None:
        self.body, self.tick, self.joints = body, tick, deepcopy(body.joints)
        elastic = () if body.two_mass is None else (body.two_mass.joint,)
        self.model = mujoco.MjModel.from_xml_string(mjcf(body.arm, copies, elastic, timestep=tick / 2))
        self.data = mujoco.MjData(self.model)
        self.shape = (copies, body.arm.joints)
        ids = [[self.model.joint(f"m{c}_{j}").id for j in range(body.arm.joints)] for c in range(copies)]
        self.motors = np.array(ids).ravel()
        self.gears = np.array([self.model.joint(f"e{c}_{j}").id for c in range(copies) for j in elastic], dtype=int)
        self.hands = np.array([self.model.body(f"p{c}").id for c in range(copies)])
        self.warm = np.full(self.shape, body.joints.heat.ambient if body.joints.heat else 25.0)
        self.load, self.rate, self.force = np.zeros(self.shape), np.zeros(self.shape), np.zeros(self.model.nv)
        self.held: bool | None = None
        if body.gravity is not None:
            self.model.opt.gravity[:] = body.gravity
        if body.two_mass is not None:
            self.model.dof_damping[self.gears] = body.two_mass.damping
            if body.two_mass.gap == 0.0:
                self.model.jnt_stiffness[self.gears] = body.two_mass.stiffness

    @property
    def position(self) -> Array:
        """(C, n) positions of the motors, rad at the joint side."""
        return np.asarray(self.data.qpos[self.motors].reshape(self.shape))

    @property
    def speed(self) -> Array:
        """(C, n) velocities of the motors."""
        return np.asarray(self.data.qvel[self.motors].reshape(self.shape))

    def hold(self, t: float) -> None:
        """Give the flange its mass, or take it away."""
        grip = self.body.grip
        if grip is None or grip.held(t) == self.held:
            return
        self.held = grip.held(t)
        self.model.body_mass[self.hands] = grip.mass if self.held else 0.0
        self.model.body_ipos[self.hands] = grip.com

    def step(self, t: float, torque: Array) -> None:
        """One tick under the motors' torque (C, n), held for the tick.

        Friction goes in as its tangent, a force and a damping that MuJoCo integrates implicitly. Two half-tick steps
        use the velocities at their ends, on average a quarter of a tick late, which the acceleration makes up for.
        """
        speed, arm, tick, gears = self.speed, self.body.arm, self.tick, self.body.two_mass
        safe = np.where(np.abs(speed) < STILL, STILL, speed)
        moment = Moment(t, tick, self.position, safe, np.tanh(safe / SIGN_WIDTH), self.load, self.warm)
        slowing, extra = self.joints.friction(moment), self.joints.load(moment)
        slope = steepness(slowing, moment, self.joints.viscous)
        late = np.minimum(0.25 * tick * slope, 0.3 * arm.rotor) * self.rate
        self.model.dof_damping[self.motors] = slope.ravel()
        self.force[self.motors] = (torque - extra - slowing + slope * speed + late).ravel()
        if gears is not None and gears.gap > 0.0:
            self.force[self.gears] = -gears.torque(self.data.qpos[self.gears])
        self.data.qfrc_applied[:] = self.force
        mujoco.mj_step(self.model, self.data, 2)
        change = self.speed - speed
        self.rate = change / tick
        self.load = torque - extra - slowing - slope * 0.75 * change - arm.rotor * self.rate
        if self.joints.heat:
            copper = arm.resistance * (torque / arm.constant) ** 2
            self.joints.heat.step(self.warm, np.abs(slowing * speed) + copper, tick)

    def follow(self, q: Array, v: Array, wanted: Array, control: Controller) -> Trace:
        """Track (N, C, n) positions and velocities with the wanted torque fed forward."""
        n, tick = len(q), self.tick
        t = np.arange(n) * tick - LEAD
        q_log, v_log, a_log, torque_log = (np.empty((n, *self.shape), np.float32) for _ in range(4))
        warm_log = np.empty((n, *self.shape), np.float32) if self.joints.heat else None
        self.data.qpos[self.motors] = q[0].ravel()
        for i in range(n):
            self.hold(float(t[i]))
            here, speed = self.position, self.speed
            torque = wanted[i] + control.stiffness * (q[i] - here) + control.damping * (v[i] - speed)
            if warm_log is not None:
                warm_log[i] = self.warm
            self.step(float(t[i]), torque)
            q_log[i], v_log[i] = here + MIDDLE * tick * speed, speed + 0.5 * tick * self.rate
            a_log[i], torque_log[i] = self.rate, torque
        return Trace(tick, t + MIDDLE * tick, q_log, v_log, a_log, torque_log, warm_log)
