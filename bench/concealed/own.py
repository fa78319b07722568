"""Simulations that are the user's own: what robot.yaml, the URDF and the clock say otherwise than the simulation does.

A case is drawn as ever, and the question stays what the simulation leaves out. `prepare` gives simulation and arm,
before the effects are drawn, what the description will not have; `describe` writes the description after them.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from concealed.arms import Arm, Array, mistune
from concealed.effects import KINDS
from concealed.effects.masses import hand
from concealed.plant import rigid_torque
from concealed.setting import Setting, require
from concealed.simulation import Clock

OWN = {
    "bare": "robot.yaml knows no friction, rotors, windings or standby power",
    "tool": "simulation and arm have a tool that the URDF lacks",
    "off": "robot.yaml's figures are far off, the simulation's are right",
    "known": "robot.yaml or the URDF has right what the simulation leaves out",
    "term": "simulation and arm have a term that no description has",
    "clock": "the simulation has its own step and its own clock",
}
"""The kinds, and what each is."""
KNOWABLE = {
    "coulomb_friction",
    "viscous_friction",
    "rotor_inertia",
    "copper_loss",
    "standby_power",
    "payload",
    "link_inertial_error",
}
"""Effects that a description can hold while the simulation does not."""
TORQUE_TERMS, SUPPLY_TERMS = ("stribeck_friction", "load_dependent_friction"), ("iron_loss", "converter_efficiency")
RATES, SLOW_RATES = (40.0, 240.0, 500.0, 1000.0), (40.0, 60.0, 100.0)
"""Hz of simulations with their own step; the second for long runs."""


@dataclass
class Own:
    """What is the user's own in a case: `described` is what robot.yaml and the URDF say, `facts` go into the key.

    `belief` is the arm as somebody knows it who leaves nothing out, off by a few per cent.
    """

    kind: str
    belief: Arm
    described: Arm
    facts: dict[str, Any] = field(default_factory=dict)


def few_per_cent(rng: np.random.Generator) -> float:
    """A factor that a figure of the simulation is off by."""
    return float(1.0 + 0.02 * np.clip(rng.normal(), -2.0, 2.0))


def carrying(arm: Arm, mass: float, com: Array) -> Arm:
    """The arm with a mass (kg, m in the frame of the last link) as part of that link; axes stay those of the link."""
    total = arm.mass[-1] + mass
    middle = (arm.mass[-1] * arm.com[-1] + mass * com) / total
    about = lambda m, r: m * (r @ r - r**2)  # noqa: E731
    masses, coms, inertia = arm.mass.copy(), arm.com.copy(), arm.inertia.copy()
    inertia[-1] += about(arm.mass[-1], arm.com[-1] - middle) + about(mass, com - middle)
    masses[-1], coms[-1] = total, middle
    return replace(arm, mass=masses, com=coms, inertia=inertia)


def prepare(s: Setting, kind: str, effects: Collection[str]) -> Own:
    """Put into simulation and arm what the description will lack; `effects` are those that the case will have."""
    # In half of the cases the simulator has read the same files, in the others somebody has set it up anew.
    belief = s.believed if s.rng.random() < 0.5 else mistune(s.rng, s.base)
    own = Own(kind, belief, belief)
    if kind == "tool":
        add_tool(s, own)
    elif kind == "term":
        add_terms(s, own, effects)
    elif kind == "clock":
        slow = s.run_set in ("medium", "long")
        rate = float(s.rng.choice([r for r in (SLOW_RATES if slow else RATES) if r != s.interface.rate]))
        start = float(s.rng.uniform(2e3, 2e5)) if s.rng.random() < 0.7 else 0.0
        s.simulation.clock = Clock(rate, start, float(s.rng.uniform(0.0, 1.2)) if start else 0.0)
        own.facts = {"rate": rate, "start": start, "lead": s.simulation.clock.lead}
    return own


def add_tool(s: Setting, own: Own) -> None:
    """A tool at the flange of arm and simulation."""
    own.belief = s.believed
    mass, com = float(s.base.rated_payload * s.rng.uniform(0.25, 0.6)), hand(s) + s.base.flange
    s.believed = carrying(s.believed, mass * few_per_cent(s.rng), com + 0.001 * s.rng.normal(size=3))
    s.base = carrying(s.base, mass, com)
    s.body.arm = s.base
    s.rigid = rigid_torque(s.body, s.q, s.v, s.a, s.t)
    own.facts = {"mass": mass, "com": com.tolist()}


def add_terms(s: Setting, own: Own, effects: Collection[str]) -> None:
    """One or two terms of the table that simulation and arm both have; none of them is an effect of the case."""
    torque, supply = ([t for t in terms if t not in effects] for terms in (TORQUE_TERMS, SUPPLY_TERMS))
    which = int(s.rng.integers(3))
    chosen = [str(s.rng.choice(terms)) for terms, use in ((torque, which != 1), (supply, which != 0)) if use and terms]
    require(bool(chosen))
    s.level = "strong"
    terms = []
    for name in chosen:
        joint = int(s.rng.integers(s.joints)) if KINDS[name].joints else None
        terms.append({"term": name, "joint": joint, **KINDS[name].draw(s, joint or 0)})
    told = s.simulation
    told.true_frictions, told.true_supply = list(s.body.joints.frictions), s.supply
    told.frictions = [mistuned_term(s.rng, f) for f in s.body.joints.frictions]
    told.efficiency = 1.0 - (1.0 - s.supply.efficiency) * few_per_cent(s.rng)
    if (iron := s.supply.iron) is not None:
        told.iron = replace(
            iron, hysteresis=iron.hysteresis * few_per_cent(s.rng), eddy=iron.eddy * few_per_cent(s.rng)
        )
    own.facts = {"terms": terms}


def mistuned_term(rng: np.random.Generator, term: Any) -> Any:
    """The term with its size off by a little."""
    name = next(n for n in ("excess", "coefficient") if hasattr(term, n))
    return replace(term, **{name: getattr(term, name) * few_per_cent(rng)})


def describe(s: Setting, own: Own, effects: Collection[str]) -> Own:
    """The same with the arm as robot.yaml and the URDF say it."""
    match own.kind:
        case "bare":
            own.described = knowing_nothing(s, own)
        case "off":
            own.described = far_off(s, own)
        case "known":
            own.described = knowing(s, own, effects)
        case "tool":
            bare = own.belief
            own.described = replace(s.believed, mass=bare.mass, com=bare.com, inertia=bare.inertia)
        case _:
            own.described = s.believed
    return own


def knowing_nothing(s: Setting, own: Own) -> Arm:
    """No friction, rotors, windings or standby power; in half of the cases not even as zeros."""
    own.facts = {"keys_left_out": bool(s.rng.random() < 0.5)}
    none = np.zeros(s.joints)
    return replace(own.belief, coulomb=none, viscous=none, rotor=none, resistance=none, standby=0.0)


def far_off(s: Setting, own: Own) -> Arm:
    """Friction off by a third in all joints; rotors, windings and standby power in some of the cases."""
    about = lambda *values: float(s.rng.choice(values) * s.rng.uniform(0.95, 1.05))  # noqa: E731
    factors = {
        "coulomb": about(1.35, 1.35, 0.65),
        "viscous": about(0.7, 0.7, 1.4),
        "rotor": about(1.0, 1.0, 0.75),
        "resistance": about(1.0, 1.0, 1.4),
        "standby": about(1.0, 1.0, 0.8),
    }
    own.facts = {"factors": factors}
    return replace(own.belief, **{name: getattr(own.belief, name) * factor for name, factor in factors.items()})


def knowing(s: Setting, own: Own, effects: Collection[str]) -> Arm:
    """What the simulation leaves out, as the description has it."""
    described = own.belief
    if "link_inertial_error" in effects:
        wrong = s.body.arm
        described = replace(
            described,
            mass=described.mass * wrong.mass / s.base.mass,
            com=described.com + wrong.com - s.base.com,
        )
    if "payload" in effects and s.body.grip is not None:
        described = carrying(described, s.body.grip.mass, s.body.grip.com + s.base.flange)
    own.facts = {"known": sorted(KNOWABLE.intersection(effects))}
    return described
