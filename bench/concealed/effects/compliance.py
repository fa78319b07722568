"""Motor and link as two masses, and the push from outside."""

from __future__ import annotations

import numpy as np

from concealed import mechanics
from concealed.arms import Array
from concealed.effects.kinds import Kind, Truth, by_level, either, every, into
from concealed.law import RigidBody
from concealed.plant import TwoMass
from concealed.setting import Setting, require

COMPLIANCE: dict[str, Kind] = {}


def link_share(s: Setting, joint: int) -> tuple[float, Array]:
    """Inertia of the links at the joint in the middle of the range, and the torque (N, C) that passes the gear."""
    middle = 0.5 * (s.base.low + s.base.high)
    return float(RigidBody(s.base).inertia(middle)[joint]), s.rigid[:, :, joint]


@into(COMPLIANCE, lambda n: range(4), "jerky")
def joint_elasticity(s: Setting, joint: int) -> Truth:
    """Motor and link on a spring; sized by the torque that the twist's acceleration costs."""
    inertia, load = link_share(s, joint)
    twist = np.gradient(np.gradient(load, s.grid, axis=0), s.grid, axis=0)
    wanted = inertia * s.rms(twist) / (s.target() * s.base.noise[joint])
    low, high = inertia * (2 * np.pi * np.array([3.5, 14.0])) ** 2
    stiffness = float(np.clip(wanted, low, high))
    damping = float(2 * s.rng.uniform(0.01, 0.05) * np.sqrt(stiffness * inertia))
    s.body.two_mass = TwoMass(joint, stiffness, damping)
    return {"stiffness": stiffness, "damping": damping}


@into(COMPLIANCE, lambda n: range(1, n), "jerky")
def backlash(s: Setting, joint: int) -> Truth:
    """A dead zone between motor and link, on a spring too stiff to show by itself."""
    inertia, load = link_share(s, joint)
    crossings = sum(np.count_nonzero(np.diff(np.sign(load[:, c]))) for c in range(s.opens))
    require(bool(crossings >= 12))
    stiffness = inertia * float(2 * np.pi * s.rng.uniform(22.0, 32.0)) ** 2
    damping = 2 * 0.12 * np.sqrt(stiffness * inertia)
    gap = by_level(s, 0.004, 0.008, 0.014, 0.022)
    s.body.two_mass = TwoMass(joint, stiffness, float(damping), gap)
    return {"stiffness": stiffness, "damping": float(damping), "gap": gap}


@into(COMPLIANCE, every)
def external_contact(s: Setting, joint: int) -> Truth:
    """One push, in one of the open runs."""
    run = int(s.rng.integers(s.opens))
    width = float(s.rng.uniform(0.2, 0.5))
    time = float(s.rng.uniform(4.0, s.plans[run].seconds - 4.0))
    torque = either(s) * by_level(s, 5.0, 10.0, 20.0, 35.0) * float(s.base.noise[joint])
    s.body.joints.loads.append(mechanics.Push(joint, run, time, width, torque))
    return {"runs": [run], "time": time, "width": width, "torque": torque}
