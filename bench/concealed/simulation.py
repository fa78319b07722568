"""What the simulation says for a planned motion: its law, terms of its own, its own step and clock."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from concealed.arms import Arm, Array
from concealed.law import RigidBody, friction
from concealed.mechanics import Friction, Joints, playback
from concealed.motion import Plan
from concealed.sensing import at
from concealed.supply import Iron, Supply


@dataclass(frozen=True)
class Clock:
    """A simulation's own step, Hz; it says `start` s when the plan is at -`lead` s, and rests as long at the end."""

    rate: float
    start: float
    lead: float


@dataclass
class Simulation:
    """What a simulation has beyond the description's law; by default nothing, on the recording's samples.

    `true_frictions` and `true_supply` are the same terms as the arm has them.
    """

    frictions: list[Friction] = field(default_factory=list)
    iron: Iron | None = None
    efficiency: float = 1.0
    clock: Clock | None = None
    true_frictions: list[Friction] = field(default_factory=list)
    true_supply: Supply | None = None


def planned(plan: Plan, t: Array) -> tuple[Array, Array, Array]:
    """Position, velocity and acceleration (N, n) of the plan at times t."""
    grid = np.arange(len(plan.q)) * plan.tick
    return at(t, grid, plan.q), at(t, grid, plan.v), at(t, grid, plan.a)


def torque_of(arm: Arm, frictions: list[Friction], t: Array, q: Array, v: Array, a: Array) -> Array:
    """(N, n) torque of the description's law and of further friction, Nm."""
    rigid = RigidBody(arm).torque(q, v, a)
    out = rigid + arm.rotor * a + friction(arm, v)
    if not frictions:
        return np.asarray(out)
    alone = Joints(np.zeros(arm.joints), np.zeros(arm.joints), frictions)
    return np.asarray(out + playback(arm, alone, q[:, None], v[:, None], rigid[:, None], t)[:, 0])


def said(arm: Arm, simulation: Simulation, plan: Plan, t: Array) -> dict[str, Array]:
    """What the simulation says at times t (N,) of the plan: q, qd, qdd, tau (N, n) and power (N,)."""
    q, v, a = planned(plan, t)
    torque = torque_of(arm, simulation.frictions, t, q, v, a)
    supply = replace(Supply.of(arm), iron=simulation.iron, efficiency=simulation.efficiency)
    return {"q": q, "qd": v, "qdd": a, "tau": torque, "power": supply.power(t, torque, v)}


def own_times(clock: Clock, seconds: float) -> Array:
    """(N,) times of the plan at which a simulation with its own step speaks; the clock says `start + lead` s more."""
    return np.arange(round((seconds + 2 * clock.lead) * clock.rate)) / clock.rate - clock.lead
