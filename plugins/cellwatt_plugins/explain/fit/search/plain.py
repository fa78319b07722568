"""Friction first: the terms that every arm has are added at all joints in one step, before finer effects."""

from __future__ import annotations

from collections.abc import Collection

from cellwatt_plugins.explain.fit.acceptance import sound
from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.explain.fit.search.solve import reweigh, solve, without
from cellwatt_plugins.explain.fit.search.state import SearchState
from cellwatt_plugins.explain.fit.solution import Solution

ALWAYS = ("coulomb_friction", "viscous_friction")
PLAIN = (*ALWAYS, "torque_offset")
"""Measured torques may also have an offset."""
SUPPLY = ("standby_power", "copper_loss")


def plain_terms(state: SearchState, now: Solution) -> Solution:
    """The solution with the terms that every arm has and the simulation lacks, where they are physical.

    These are friction and an offset of each joint without known friction, or standby power and copper losses of the
    supply, where no term acts yet. All are fitted together; finer effects are searched beside them, and only then is
    each tested for need: before an unknown balancer is found, friction may not show.
    """
    plain = _lacking(state, {t.joint for t in now.terms})
    if not plain:
        return now
    now = reweigh(state, solve(state, [*now.terms, *plain]))
    for term in sorted(plain, key=lambda t: now.fit.added(now.block(t)[1])):
        if not sound(now, term):
            state.refuse(term, now.fit.added(now.block(term)[1]), "has a sign that is not physical")
            now = without(state, now, term)
    return reweigh(state, now)


def _lacking(state: SearchState, occupied: Collection[int | None]) -> list[Term]:
    effects = {effect.name: effect for effect in state.effects}
    if state.problem.side == "supply":
        if occupied:
            return []
        return [
            Term(effect, None, ())
            for effect in (effects[name] for name in SUPPLY if name in effects)
            if not effect.described(state.robot, None) and effect.possible(state.robot, None)
        ]
    if not all(name in effects for name in ALWAYS):
        return []
    own = [effects[name] for name in PLAIN if name in effects]
    bare = [j for j in state.moving if j not in occupied]
    unknown = [j for j in bare if not any(effect.described(state.robot, j) for effect in own)]
    return [Term(effect, joint, ()) for joint in unknown for effect in own]
