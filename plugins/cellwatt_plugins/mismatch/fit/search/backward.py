"""Backward elimination: what makes a term leave that once entered."""

from __future__ import annotations

import numpy as np

from cellwatt_plugins.mismatch.fit.acceptance import required_gain, seen_by_several, unconfirmed
from cellwatt_plugins.mismatch.fit.search.candidates import has_friction
from cellwatt_plugins.mismatch.fit.search.solve import solve, without
from cellwatt_plugins.mismatch.fit.search.state import SearchState
from cellwatt_plugins.mismatch.fit.problem import Term
from cellwatt_plugins.mismatch.fit.solution import Solution


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
            last = solve(state, [*others, term])
            if gain < state.thresholds.least or unconfirmed(rest, last, state.thresholds, gain) is not None:
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


def drop_unconfirmed(state: SearchState, now: Solution) -> Solution:
    """Terms that data left out do not confirm beside the others leave, the smallest first."""
    for term in sorted(now.terms, key=lambda t: _size(now, t)):
        rest = without(state, now, term)
        last = solve(state, [*rest.terms, term])
        gain = rest.fit.gain(rest.problem.block(term))[0]
        why = unconfirmed(rest, last, state.thresholds, gain)
        if why is None and term.effect.acceptance.several_channels and not seen_by_several(rest, last.block(term)[0]):
            why = "only one channel asks for it"
        if why is not None:
            state.refuse(term, gain, f"beside the others {why}")
            now = rest
    return now


def _size(now: Solution, term: Term) -> float:
    """Size of what a term adds, in units of the noise."""
    added = now.block(term)[0].times(now.coefficients(term), len(now.problem.floor)) / now.problem.floor
    return float(np.sqrt(np.mean(np.square(added))))
