"""Backward elimination: what makes a term leave that once entered."""

from __future__ import annotations

import numpy as np

from cellwatt_plugins.mismatch.fit.acceptance import (
    lowers_held_out_error,
    raises_held_out_error,
    relieves_tension,
    required_gain,
    seen_by_several,
)
from cellwatt_plugins.mismatch.fit.problem import Term
from cellwatt_plugins.mismatch.fit.search.candidates import has_friction
from cellwatt_plugins.mismatch.fit.search.solve import solve, without
from cellwatt_plugins.mismatch.fit.search.state import SearchState
from cellwatt_plugins.mismatch.fit.solution import Solution
from cellwatt_plugins.mismatch.fit.swinging_links import remaining_chi2

FRICTION = ("coulomb_friction", "viscous_friction")
PLAIN = 0.4
"""Of the share that other terms must explain, what plain friction must."""
EXCESS = 0.35
"""Mean square residual beyond noise, in units of the noise, that is much."""


def drop_needless(state: SearchState, now: Solution, keep: int = 1) -> Solution:
    """Terms that the later ones made needless leave; the last ``keep`` stay."""
    for term in list(now.terms[: len(now.terms) - keep]):
        others = [t for t in now.terms if t is not term]
        shaping = any(t.joint == term.joint and t.effect.acts_on == "friction" for t in others)
        if shaping and not has_friction(state, term.joint, others):
            continue
        rest = solve(state, others)
        gain = rest.fit.gain(now.problem.block(term))[0]
        if gain < required_gain(term, state.robot, state.thresholds):
            state.refuse(term, gain, "needless beside the others")
            now = rest
    return now


def drop_within_model_error(state: SearchState, now: Solution) -> Solution:
    """Terms that add less than the form of another one there may be wrong by leave."""
    for term in list(now.terms):
        doubt = {t.effect.name: t.effect.form.error * _size(now, t) for t in now.terms if t is not term}
        name = max(doubt, key=lambda n: doubt[n], default="")
        if name and _size(now, term) < doubt[name]:
            state.refuse(term, 0.0, f"is less than the form of {name.replace('_', ' ')} may be wrong by")
            now = without(state, now, term)
    return now


def drop_minor(state: SearchState, now: Solution) -> Solution:
    """Terms of a joint that explain little of what differs there leave: they only lean on the unknown.

    Plain friction that the simulation lacks is judged as one, and by less: every joint has some.
    """
    for term in list(now.terms):
        left = remaining_chi2(now)
        if term not in now.terms or term.joint is None or term.effect.form.sample_by_sample:
            continue
        if left[term.joint] - 1 < EXCESS:
            continue
        plain = _plain_friction(state, now, term)
        together = plain or [term]
        rest = solve(state, [t for t in now.terms if t not in together])
        drop = float(remaining_chi2(rest)[term.joint] - left[term.joint])
        share = drop / (drop + float(left[term.joint]) - 1)
        if share < state.thresholds.credible * (PLAIN if plain else 1.0):
            for each in together:
                state.refuse(each, 0.0, f"explains {100 * share:.0f} % of what differs")
            now = rest
    return now


def _plain_friction(state: SearchState, now: Solution, term: Term) -> list[Term]:
    """All plain friction that the simulation lacks at the joint of a term of that kind; else nothing."""

    def plain(each: Term) -> bool:
        return each.effect.name in FRICTION and each.effect.described(state.robot, each.joint) == 0

    return [t for t in now.terms if t.joint == term.joint and plain(t)] if plain(term) else []


def drop_unconfirmed(state: SearchState, now: Solution) -> Solution:
    """Terms that, beside the later ones, no longer show on data left out or in several channels leave."""
    for term in sorted(now.terms, key=lambda t: _size(now, t)):
        if term.effect.form.intermittent or term.effect.form.sample_by_sample:
            continue
        rest = without(state, now, term)
        last = solve(state, [*rest.terms, term])
        if (why := _unconfirmed(state, rest, last, term)) is not None:
            state.refuse(term, rest.fit.gain(rest.problem.block(term))[0], why)
            now = rest
    return now


def _unconfirmed(state: SearchState, rest: Solution, last: Solution, term: Term) -> str | None:
    """Why the last term is not confirmed beside the others; None where it is."""
    if term.effect.acceptance.several_channels and not seen_by_several(rest, last.block(term)[0]):
        return "beside the others only one channel asks for it"
    if raises_held_out_error(rest, last):
        return "beside the others it raises the error on data left out"
    if relieves_tension(rest, last, state.thresholds) or lowers_held_out_error(rest, last, state.thresholds):
        return None
    return "beside the others it hardly lowers the error on data left out"


def _size(now: Solution, term: Term) -> float:
    """Size of what a term adds, in units of the noise."""
    added = now.block(term)[0].times(now.coefficients(term), len(now.problem.floor)) / now.problem.floor
    return float(np.sqrt(np.mean(np.square(added))))
