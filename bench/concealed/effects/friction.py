"""Friction that the simulation leaves out, or has in another form."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from concealed import mechanics
from concealed.arms import Array
from concealed.effects.kinds import Kind, Truth, either, every, into, without
from concealed.setting import RATIO, Setting, require

FRICTION: dict[str, Kind] = {}


@into(FRICTION, every)
def coulomb_friction(s: Setting, joint: int) -> Truth:
    """The simulation has no Coulomb friction at the joint."""
    s.believed = replace(s.believed, coulomb=without(s.believed.coulomb, joint))
    return {"force": float(s.base.coulomb[joint])}


@into(FRICTION, every)
def viscous_friction(s: Setting, joint: int) -> Truth:
    """The simulation has no viscous friction at the joint."""
    s.believed = replace(s.believed, viscous=without(s.believed.viscous, joint))
    require(s.base.viscous[joint] * s.rms(s.v[:, :, joint]) / s.base.noise[joint] > RATIO["weak"][0])
    return {"coefficient": float(s.base.viscous[joint])}


@into(FRICTION, every)
def stribeck_friction(s: Setting, joint: int) -> Truth:
    """More friction at low speed."""
    velocity = float(s.base.speed[joint] * s.rng.uniform(0.03, 0.08))
    term = lambda x: mechanics.Stribeck(joint, x, velocity)  # noqa: E731
    excess = s.size(joint, term, 0.9 * s.base.coulomb[joint])
    s.body.joints.frictions.append(term(excess))
    return {"excess": excess, "velocity": velocity}


@into(FRICTION, every)
def load_dependent_friction(s: Setting, joint: int) -> Truth:
    """Friction in proportion to the torque through the gear."""
    coefficient = s.size(joint, lambda x: mechanics.LoadFriction(joint, x), 0.2)
    s.body.joints.frictions.append(mechanics.LoadFriction(joint, coefficient))
    return {"coefficient": coefficient}


@into(FRICTION, every)
def asymmetric_friction(s: Setting, joint: int) -> Truth:
    """Friction that differs by direction."""
    difference = either(s) * s.size(joint, lambda x: mechanics.Asymmetry(joint, x), 1.3 * s.base.coulomb[joint])
    s.body.joints.frictions.append(mechanics.Asymmetry(joint, difference))
    return {"difference": difference}


@into(FRICTION, every)
def nonlinear_viscous_friction(s: Setting, joint: int) -> Truth:
    """Friction with another power of speed beside the viscous one."""
    exponent = float(s.rng.choice([3.0, 3.0, 2.0, 0.5]))
    full = s.base.speed[joint]
    cap = (1.2 if exponent > 1 else 0.9) * s.base.viscous[joint] * full / full**exponent
    coefficient = s.size(joint, lambda x: mechanics.PowerLaw(joint, x, exponent), cap)
    s.body.joints.frictions.append(mechanics.PowerLaw(joint, coefficient, exponent))
    return {"coefficient": coefficient, "exponent": exponent}


def joint_heat(s: Setting, low: float, high: float) -> mechanics.Heat:
    """Thermal resistances at which the task warms each joint by `low` to `high` K in the end."""
    loss = (
        np.abs(s.v) * np.abs(s.base.coulomb + s.base.viscous * np.abs(s.v))
        + s.base.resistance * (s.torque / s.base.constant) ** 2
    )
    mean = np.maximum(np.mean(loss[:, 0][s.alive[:, 0]], axis=0), 1e-3)
    n = s.joints
    return mechanics.Heat(
        s.rng.uniform(low, high, n) / mean, s.rng.uniform(120.0, 260.0, n), float(s.rng.uniform(20, 27))
    )


@into(FRICTION, every, "long")
def temperature_dependent_friction(s: Setting, joint: int) -> Truth:
    """Friction that falls as the joint warms; the temperature is recorded in half of the cases."""
    heat = joint_heat(s, 22.0, 38.0)
    scale = float(s.rng.uniform(9.0, 16.0))

    def term(x: float) -> mechanics.Warming:
        return mechanics.Warming(joint, s.base.coulomb[joint], s.base.viscous[joint], 1 + x, scale, heat.ambient)

    share = s.size(joint, lambda x: Warmed(term(x), heat, s), 0.9)
    s.body.joints.heat = heat
    s.body.joints.frictions.append(term(share))
    s.shows_temperature = bool(s.rng.random() < 0.5)
    return {
        "cold_factor": share,
        "scale": scale,
        "recorded": s.shows_temperature,
        "time_constant": float(heat.time_constant[joint]),
    }


class Warmed:
    """A warming term that keeps its own temperature, for sizing it before the plant runs."""

    def __init__(self, term: mechanics.Warming, heat: mechanics.Heat, s: Setting) -> None:
        self.term, self.heat, self.arm = term, heat, s.base
        self.temperature = np.full((len(s.plans), s.joints), heat.ambient)

    def add(self, m: mechanics.Moment, torque: Array) -> None:
        """Friction at the present temperature, then one step of warming."""
        m.temperature = self.temperature
        self.term.add(m, torque)
        slow = self.arm.coulomb * m.sign + self.arm.viscous * m.v
        copper = self.arm.resistance * ((m.load + slow) / self.arm.constant) ** 2
        self.heat.step(self.temperature, slow * m.v + copper, m.dt)


@into(FRICTION, every)
def presliding_hysteresis(s: Setting, joint: int) -> Truth:
    """Coulomb friction that builds up over a displacement after each reversal."""
    force = float(s.base.coulomb[joint] * s.rng.uniform(0.75, 1.0))
    ways = np.geomspace(0.003, 0.06, 8)
    ratios = np.array([s.ratio(joint, mechanics.Dahl(joint, force, w), force) for w in ways])
    best = int(np.argmin(np.abs(np.log(ratios / s.target()))))
    require(ratios[best] > RATIO["weak"][0])
    displacement = float(ways[best])
    coulomb = s.body.joints.coulomb.copy()
    coulomb[joint] -= force
    s.body.joints.coulomb = coulomb
    s.body.joints.loads.append(mechanics.Dahl(joint, force, displacement))
    return {"force": force, "displacement": displacement}
