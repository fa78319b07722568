"""Masses, gravity, springs and everything else that loads a joint by its position or acceleration."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from concealed import mechanics
from concealed.arms import Array
from concealed.effects.kinds import Kind, Truth, by_level, every, into, without
from concealed.law import gravity_of
from concealed.plant import Body, Grip, rigid_torque
from concealed.setting import RATIO, Setting, require

MASSES: dict[str, Kind] = {}


def hand(s: Setting) -> Array:
    """A centre of mass a few centimetres in front of the flange, in the flange frame."""
    ahead = s.base.flange / np.linalg.norm(s.base.flange)
    return np.asarray(ahead * s.rng.uniform(0.02, 0.08) + s.rng.uniform(-0.025, 0.025, 3))


@into(MASSES, None)
def payload(s: Setting, joint: int) -> Truth:
    """A mass at the flange; its centre is given in the frame of the last link."""
    mass = s.base.rated_payload * by_level(s, 0.08, 0.2, 0.45, 0.9)
    com = hand(s)
    s.body.grip = Grip(mass, com)
    return {"mass": mass, "com": [float(x) for x in com + s.base.flange]}


@into(MASSES, None)
def payload_change(s: Setting, joint: int) -> Truth:
    """A mass that is picked up and put down again and again."""
    mass = s.base.rated_payload * by_level(s, 0.12, 0.25, 0.5, 0.9)
    period = float(s.rng.uniform(8.0, 15.0))
    hold, start, com = period * s.rng.uniform(0.3, 0.6), s.rng.uniform(1.5, 5.0), hand(s)
    s.body.grip = Grip(mass, com, start, hold, period)
    return {
        "mass": mass,
        "com": [float(x) for x in com + s.base.flange],
        "t_on": start,
        "duration": hold,
        "period": period,
    }


@into(MASSES, lambda n: range(1, n - 2))
def link_inertial_error(s: Setting, joint: int) -> Truth:
    """A link whose mass or centre of mass is well off in the simulation."""
    share = by_level(s, 0.14, 0.22, 0.35, 0.6)
    mass, com = s.base.mass.copy(), s.base.com.copy()
    if s.rng.random() < 0.5:
        mass[joint] *= 1 + share
    else:
        com[joint] *= 1 + 1.6 * share
    arm = replace(s.base, mass=mass, com=com)
    pick = slice(None, None, max(1, round(0.08 / s.grid)))
    q, v, a = s.q[pick], s.v[pick], s.a[pick]
    differs = rigid_torque(Body(arm, s.body.joints), q, v, a, s.t[pick]) - s.rigid[pick]
    require(float(np.max(np.sqrt(np.mean(differs**2, axis=(0, 1))) / s.base.noise)) > RATIO["weak"][0])
    s.body.arm = arm
    return {"mass": float(mass[joint] - s.base.mass[joint]), "com": [float(x) for x in com[joint] - s.base.com[joint]]}


@into(MASSES, None)
def gravity_tilt(s: Setting, joint: int) -> Truth:
    """A base that is not level."""
    angle, towards = np.radians(by_level(s, 0.8, 1.6, 3.0, 6.0)), s.rng.uniform(0, 2 * np.pi)
    roll, pitch = float(angle * np.cos(towards)), float(angle * np.sin(towards))
    s.body.gravity = gravity_of(roll, pitch)
    return {"roll": roll, "pitch": pitch}


@into(MASSES, every)
def spring_load(s: Setting, joint: int) -> Truth:
    """A spring across the joint."""
    middle = 0.5 * (s.base.low[joint] + s.base.high[joint])
    rest = float(middle + s.rng.uniform(-0.4, 0.4) * 0.5 * (s.base.high[joint] - s.base.low[joint]))
    stiffness = s.size(joint, lambda x: mechanics.Spring(joint, x, rest), np.inf)
    s.body.joints.loads.append(mechanics.Spring(joint, stiffness, rest))
    return {"stiffness": stiffness, "rest": rest}


@into(MASSES, every)
def position_periodic_torque(s: Setting, joint: int) -> Truth:
    """Torque that repeats with the position of the joint."""
    cycles = float(s.rng.integers(4, 25))
    phase = float(s.rng.uniform(0, 2 * np.pi))
    amplitude = s.size(joint, lambda x: mechanics.Cogging(joint, x, cycles, phase), 0.8 * s.base.coulomb[joint])
    s.body.joints.loads.append(mechanics.Cogging(joint, amplitude, cycles, phase))
    return {"amplitude": amplitude, "cycles": cycles, "phase": phase}


@into(MASSES, every)
def rotor_inertia(s: Setting, joint: int) -> Truth:
    """The simulation has no reflected rotor inertia at the joint."""
    s.believed = replace(s.believed, rotor=without(s.believed.rotor, joint))
    require(s.base.rotor[joint] * s.rms(s.a[:, :, joint]) / s.base.noise[joint] > RATIO["weak"][0])
    return {"inertia": float(s.base.rotor[joint])}
