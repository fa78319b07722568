"""Friction first: what every arm has is asked of all joints in one step, before anything finer."""

from __future__ import annotations

from cellwatt_plugins.mismatch.fit.acceptance import unconfirmed
from cellwatt_plugins.mismatch.fit.problem import Term
from cellwatt_plugins.mismatch.fit.search.solve import reweigh, solve, without
from cellwatt_plugins.mismatch.fit.search.state import SearchState
from cellwatt_plugins.mismatch.fit.solution import Solution

PLAIN = ("coulomb_friction", "viscous_friction", "torque_offset")


def plain_friction(state: SearchState, now: Solution) -> Solution:
    """The solution with plain friction and an offset of each joint of which no friction is known, where they hold."""
    effects = {effect.name: effect for effect in state.effects}
    if not all(name in effects for name in PLAIN):
        return now
    unknown = [j for j in state.moving if not any(effects[name].described(state.robot, j) for name in PLAIN)]
    if not unknown:
        return now
    asked = [Term(effects[name], joint, ()) for joint in unknown for name in PLAIN]
    now = reweigh(state, solve(state, [*now.terms, *asked]))
    for term in sorted(asked, key=lambda t: now.fit.added(now.block(t)[1])):
        rest = without(state, now, term)
        gain = rest.fit.gain(rest.problem.block(term))[0]
        last = solve(state, [*rest.terms, term])
        backwards = bool(term.effect.nominal) and float(now.coefficients(term)[0]) < 0
        small = backwards or gain < state.thresholds.least
        why = "is needless" if small else unconfirmed(rest, last, state.thresholds, gain)
        if why is not None:
            state.refuse(term, gain, why)
            now = rest
    return reweigh(state, now)
