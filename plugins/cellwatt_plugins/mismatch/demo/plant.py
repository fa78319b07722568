"""The real arm of the demo: MuJoCo steps it with what is concealed, under a controller that knows the simulation."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.mismatch.demo.arm import JOINTS, NAMES, RANGES, Arm, mjcf
from cellwatt_plugins.mismatch.demo.physics import Concealed
from cellwatt_plugins.mismatch.simulators import load_simulator
from cellwatt_plugins.robot.mjcf import library

Float = NDArray[np.float64]

STEP = 0.001
"""s of MuJoCo."""
EVERY = 4
"""Steps to one sample."""
MIDDLE, HALF = RANGES.mean(axis=1), 0.38 * np.ptp(RANGES, axis=1)
"""rad about which and within which joints move."""
SECONDS = (32.0, 36.0)
"""Length of each run."""
SETTLE = 0.5
"""s before a run, at rest."""
RAMP = 1.5
"""s in which a swing begins and ends."""
BAND = 8.0
"""Hz of the controller's loop."""
POSITION_NOISE, VELOCITY_NOISE, TORQUE_NOISE = 2e-5, 1e-3, np.array([0.25, 0.25, 0.15, 0.05])
"""Standard deviations: rad, rad/s, Nm of each joint."""


@dataclass(frozen=True)
class Motion:
    """A planned motion, (N, n) each on the steps of MuJoCo."""

    q: Float
    qd: Float
    qdd: Float

    @classmethod
    def along(cls, q: Float) -> Motion:
        """The motion through positions."""
        qd = np.gradient(q, STEP, axis=0)
        return cls(q, qd, np.gradient(qd, STEP, axis=0))


@dataclass(frozen=True)
class Log:
    """Samples of one run: time (N,), the others (N, n)."""

    time: Float
    position: Float
    velocity: Float
    torque: Float


def motions(rng: np.random.Generator) -> list[Motion]:
    """One that swings all joints at once, and one from point to point, fast and slow, with rests."""
    return [_swings(rng, SECONDS[0]), _moves(rng, SECONDS[1])]


def _swings(rng: np.random.Generator, seconds: float) -> Motion:
    """Five sines a joint, from rest to rest."""
    t = np.arange(round(seconds / STEP)) * STEP
    speed = 2 * np.pi / seconds * rng.permuted(np.tile(np.arange(2, 13), (JOINTS, 1)), axis=1)[:, :5]
    size = rng.dirichlet(np.full(5, 2.0), JOINTS) * HALF[:, None]
    waves = np.sum(size * np.sin(t[:, None, None] * speed + rng.uniform(0, 2 * np.pi, (JOINTS, 5))), axis=2)
    return Motion.along(MIDDLE + waves * _course(np.minimum(t, t[-1] - t) / RAMP)[:, None])


def _moves(rng: np.random.Generator, seconds: float) -> Motion:
    """Minimum-jerk moves between poses; every third one is slow."""
    count, here, parts = round(seconds / STEP), MIDDLE + HALF * rng.uniform(-1, 1, JOINTS), list[Float]()
    while sum(map(len, parts)) < count:
        slow = len(parts) % 3 == 2
        way = MIDDLE + HALF * rng.uniform(-1, 1, JOINTS) - here
        way *= 0.25 if slow else 1.0
        lasts, rests = rng.uniform(3.0, 4.0) if slow else rng.uniform(1.2, 2.2), rng.uniform(0.2, 0.6)
        parts.append(here + _course(np.arange(0, lasts + rests, STEP) / lasts)[:, None] * way)
        here = here + way
    return Motion.along(np.concatenate(parts)[:count])


def _course(share: Float) -> Float:
    """Way of a minimum-jerk move, 0 to 1, at a ``share`` of its time; before and after it rests."""
    s = np.clip(share, 0, 1)
    return np.asarray(10 * s**3 - 15 * s**4 + 6 * s**5)


def run(arm: Arm, simulation: Path, concealed: Sequence[Concealed], motion: Motion, rng: np.random.Generator) -> Log:
    """Run one motion. The controller feeds forward what ``simulation``, the user's file, says, and closes a PD loop.

    Position, velocity and the motors' torque are of one instant, with the noise of sensors.
    """
    mujoco = library(simulation)
    model = mujoco.MjModel.from_xml_string(_with(arm, concealed))
    data = mujoco.MjData(model)
    user, start, still = (
        load_simulator(simulation, NAMES),
        np.tile(motion.q[0], (JOINTS, 1)),
        np.zeros((JOINTS, JOINTS)),
    )
    wanted = user.torque(motion.q, motion.qd, motion.qdd, leading=False)
    felt = np.diag(user.torque(start, still, np.eye(JOINTS)) - user.torque(start, still, still))
    speed = 2 * np.pi * BAND
    stiffness, damping = felt * speed**2, felt * 2 * speed
    dry = model.dof_frictionloss.copy()
    sticking = [(each.joint, each.numbers) for each in concealed if each.kind == "stribeck"]
    n = len(motion.q)
    data.qpos[:] = motion.q[0]
    q, qd, torque = (np.empty((n, JOINTS)) for _ in range(3))
    for i in range(-round(SETTLE / STEP), n):
        k = max(i, 0)
        data.ctrl[:] = wanted[k] + stiffness * (motion.q[k] - data.qpos) + damping * (motion.qd[k] - data.qvel)
        for joint, value in sticking:
            slow = np.exp(-((data.qvel[joint] / value["velocity"][0]) ** 2))
            model.dof_frictionloss[joint] = dry[joint] + value["excess"][0] * slow
        q[k], qd[k], torque[k] = data.qpos, data.qvel, data.ctrl
        mujoco.mj_step(model, data)
    read = [
        values[::EVERY] + spread * rng.standard_normal((len(values[::EVERY]), JOINTS))
        for values, spread in ((q, POSITION_NOISE), (qd, VELOCITY_NOISE), (torque, TORQUE_NOISE))
    ]
    return Log(np.arange(0, n, EVERY, dtype=np.float64) * STEP, *read)


def _with(arm: Arm, concealed: Sequence[Concealed]) -> str:
    """The real arm's file: friction that turns over at once, and what MuJoCo itself has a word for."""
    root = ET.fromstring(mjcf(arm))
    joints = list(root.iter("joint"))
    for joint in joints:
        joint.attrib.pop("range")
        joint.set("solreffriction", "0.002 1")
    for each in concealed:
        value, own = {name: str(number) for name, (number, _) in each.numbers.items()}, joints[each.joint or 0]
        if each.kind == "friction":
            own.set("frictionloss", value["now"])
        elif each.kind == "spring":
            own.attrib |= {"stiffness": value["stiffness"], "springref": value["rest"]}
        elif each.kind == "payload":
            last = list(root.iter("body"))[-1]
            held = ET.SubElement(last, "body", pos=f"{each.hidden['aside']} 0 {each.hidden['reach']}")
            size = 0.4 * each.numbers["mass"][0] * 0.04**2
            ET.SubElement(held, "inertial", pos="0 0 0", mass=value["mass"], diaginertia=f"{size} {size} {size}")
    return ET.tostring(root, encoding="unicode")
