"""Which cases a seed stands for, and the drawing of each."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from concealed.effects import KINDS, UNKNOWNS, Kind
from concealed.families import FAMILIES
from concealed.own import KNOWABLE, OWN, Own, describe, prepare
from concealed.record import Key, write_case
from concealed.setting import RATIO, NotVisibleError, Setting, new_setting

NULLS = {"short": 46, "jerky": 6, "medium": 6, "long": 6}
REPEATS = 3
"""Single cases of each effect, one a level of strength; unknown kinds have as many."""
MASKED = (
    ("payload", "stribeck_friction"),
    ("payload", "asymmetric_friction"),
    ("payload", "position_periodic_torque"),
    ("gravity_tilt", "presliding_hysteresis"),
    ("coulomb_friction", "stribeck_friction"),
    ("payload", "torque_offset"),
    ("viscous_friction", "nonlinear_viscous_friction"),
    ("spring_load", "position_periodic_torque"),
    ("torque_gain", "stribeck_friction"),
    ("standby_power", "converter_efficiency"),
    ("copper_loss", "iron_loss"),
    ("joint_elasticity", "asymmetric_friction"),
)
"""A large effect and a small one in the same channel."""
PAIRS = 26
SOFT, LOOPS = 0.5, (6.0, 15.0)
"""Share of the cases with a soft controller, and Hz of its loop."""


@dataclass(frozen=True)
class Spec:
    """What one case shall hold: level of the case, effects with their strength, and whether they share a joint.

    `simulation` is a kind of the user's own, or "law": it computes what robot.yaml and URDF say. A ``soft`` controller
    lets friction take the motion off its plan.
    """

    level: str
    effects: tuple[tuple[str, str], ...]
    run_set: str
    shared: bool = False
    simulation: str = "law"
    soft: bool = False


def kind_of(name: str) -> Kind:
    """The entry of an effect or of an unknown kind."""
    return KINDS[name] if name in KINDS else UNKNOWNS[name]


def run_set_of(names: list[str]) -> str:
    """The recordings that show all the named effects."""
    wanted = {kind_of(n).run_set for n in names} - {"short"}
    return wanted.pop() if wanted else "short"


def generator(seed: str, *words: str | int) -> np.random.Generator:
    """Random numbers that depend on the seed and the words alone."""
    digest = hashlib.sha256(":".join([seed, *map(str, words)]).encode()).digest()
    return np.random.default_rng(int.from_bytes(digest, "big"))


def draw_pair(rng: np.random.Generator) -> Spec:
    """Two effects of the table, on one joint in half of the cases where both have one."""
    names = list(KINDS)
    while True:
        pair = [str(x) for x in rng.choice(names, 2, replace=False)]
        sets = {kind_of(n).run_set for n in pair} - {"short"}
        hides = {"payload", "payload_change"} <= set(pair) or {"joint_elasticity", "backlash"} <= set(pair)
        if len(sets) < 2 and not hides:
            break
    levels = [str(x) for x in rng.choice(list(RATIO), 2)]
    shared = all(kind_of(n).joints for n in pair) and bool(rng.random() < 0.5)
    return Spec("pair", tuple(zip(pair, levels, strict=True)), run_set_of(pair), shared)


def specs(seed: str) -> list[Spec]:
    """All cases of the benchmark in the order of the draw."""
    rng = generator(seed, "cases")
    out = [Spec("null", (), s) for s, count in NULLS.items() for _ in range(count)]
    for name in KINDS:
        levels = list(RATIO)
        out += [Spec("single", ((name, levels[k % 3]),), run_set_of([name])) for k in range(REPEATS)]
    out += [Spec("masked", ((a, "strong"), (b, "medium")), run_set_of([a, b]), True) for a, b in MASKED]
    out += [draw_pair(rng) for _ in range(PAIRS)]
    for name in UNKNOWNS:
        out += [Spec("unknown", ((name, level),), "short") for level in RATIO]
    drawn = with_own(generator(seed, "own"), [out[i] for i in rng.permutation(len(out))])
    soft = generator(seed, "loops").random(len(drawn)) < SOFT
    return [replace(spec, soft=bool(one)) for spec, one in zip(drawn, soft, strict=True)]


def with_own(rng: np.random.Generator, all_specs: list[Spec]) -> list[Spec]:
    """The same cases, half of each level with a simulation that is the user's own; its kinds come equally often.

    A description that knows more than the simulation needs an effect that it can know: three quarters of those.
    """
    out, anywhere = list(all_specs), [k for k in OWN if k != "known"]
    turn = 0
    for level in dict.fromkeys(s.level for s in all_specs):
        cases = rng.permutation([i for i, s in enumerate(all_specs) if s.level == level])
        for i in map(int, cases[: (len(cases) + int(rng.integers(2))) // 2]):
            knowable = KNOWABLE.intersection(e for e, _ in all_specs[i].effects)
            if knowable and rng.random() < 0.75:
                out[i] = replace(all_specs[i], simulation="known")
                continue
            out[i] = replace(all_specs[i], simulation=anywhere[turn % len(anywhere)])
            turn += 1
    return out


def joints_for(rng: np.random.Generator, spec: Spec, n: int) -> list[int]:
    """One joint for each effect of the case (any number for effects without one)."""
    allowed = [list(k.joints(n)) if k.joints else list(range(n)) for k in (kind_of(e) for e, _ in spec.effects)]
    if spec.shared:
        both = sorted(set.intersection(*map(set, allowed)))
        return [int(rng.choice(both))] * len(allowed)
    chosen: list[int] = []
    for options in allowed:
        chosen.append(int(rng.choice([j for j in options if j not in chosen] or options)))
    return chosen


def build(rng: np.random.Generator, spec: Spec) -> tuple[Setting, list[Key], Own | None]:
    """One attempt at a case, with what is the user's own; raises NotVisibleError where an effect does not show."""
    family = str(rng.choice(list(FAMILIES)))
    n = len(FAMILIES[family].mass)
    joints = joints_for(rng, spec, n)
    named = [j for j, (e, _) in zip(joints, spec.effects, strict=True) if kind_of(e).joints]
    s = new_setting(rng, family, spec.run_set, sorted(set(named)))
    names = [e for e, _ in spec.effects]
    own = None if spec.simulation == "law" else prepare(s, spec.simulation, names)
    effects = []
    for joint, (name, level) in zip(joints, spec.effects, strict=True):
        s.level, entry = level, kind_of(name)
        truth = entry.draw(s, joint)
        label = f"unknown_{name}" if name in UNKNOWNS else name
        effects.append({"effect": label, "joint": joint if entry.joints else None, "strength": level, **truth})
    return s, effects, None if own is None else describe(s, own, names)


def make_case(seed: str, index: int, spec: Spec, work: Path) -> Key:
    """Draw the case, attempt after attempt until every effect shows, and write its files."""
    name = f"case-{index + 1:03d}"
    for attempt in range(200):
        rng = generator(seed, "case", index, attempt)
        try:
            s, effects, own = build(rng, spec)
            s.hertz = generator(seed, "loop", index, attempt).uniform(*LOOPS) if spec.soft else None
            return write_case(s, effects, spec.level, name, work, own)
        except NotVisibleError:
            continue
    raise NotVisibleError(f"{name}: {spec} shows with no arm in 200 draws")
