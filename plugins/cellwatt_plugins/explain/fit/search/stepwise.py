"""Stepwise selection: the set of terms with the greatest evidence, found step by step.

Forward: the candidate that adds the most evidence is added, and each term is tried against every other name. Backward:
terms are removed that the others make needless, or that data left out do not confirm. Nominal parameters are free
throughout.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.progress import steps
from cellwatt_plugins.explain.fit.problem import Place, Term, title
from cellwatt_plugins.explain.fit.retuning import confirmed, freed, looseness
from cellwatt_plugins.explain.fit.search.backward import (
    drop_ambiguous,
    drop_for_plainer,
    drop_needless,
    drop_unconfirmed,
    drop_within_model_error,
)
from cellwatt_plugins.explain.fit.search.candidates import rivals
from cellwatt_plugins.explain.fit.search.curves import drop_ill_formed, with_curves
from cellwatt_plugins.explain.fit.search.forward import RIVALS, enter, swap
from cellwatt_plugins.explain.fit.search.plain import plain_terms
from cellwatt_plugins.explain.fit.search.refine import refine
from cellwatt_plugins.explain.fit.search.solve import reweigh, solve
from cellwatt_plugins.explain.fit.search.state import Make, SearchState
from cellwatt_plugins.explain.fit.solution import Candidate, Solution, Trial
from cellwatt_plugins.explain.fit.thresholds import DEFAULT, Thresholds
from cellwatt_plugins.robot.effects import EFFECTS
from cellwatt_plugins.robot.effects.effect import Effect

CHECKS = (drop_within_model_error, drop_for_plainer, drop_ambiguous, drop_ill_formed, drop_unconfirmed)
"""Checks that each term must pass beside the others, in this order."""


def search(
    make: Make,
    channels: int,
    thresholds: Thresholds = DEFAULT,
    effects: Sequence[Effect] = EFFECTS,
    until: float = float("inf"),
    powered: bool = False,
) -> Solution:
    """Terms of one side that the data support; ``powered``: the supply's power is judged afterwards.

    Nothing more is tried from ``until`` s on; see ``state.now``. ``make`` creates the problem for friction (C,) Nm
    beyond the nominal that reverses with the velocity, and for a delay of the measured torques in s.
    """
    still = np.zeros(channels)
    problem = make(still, 0.0)
    own = tuple(e for e in effects if (e.place == "supply") == (problem.side == "supply"))
    state = SearchState(make, thresholds, own, still, problem, powered=powered, until=until)
    now = _found(state, ())
    loose = looseness(state.problem, now.terms, now.factor) if effects else 1.0
    if loose > 1 and not state.spent():
        state.looseness = loose
        state.turn(np.zeros_like(state.turning), 0.0)
        now = _found(state, now.terms)
    free, others = state.problem, _rivals(state, now)
    state.use(freed(state.problem, confirmed(state.problem, now.terms, now.factor)))
    now = drop_unconfirmed(state, solve(state, now.terms))
    now.spent, now.free = state.spent(), free
    now.unsearched = tuple(j for j in state.moving if j in state.unsearched) if now.spent else ()
    now.rivals = {term.place: others[term.place] for term in now.terms}
    refused = [trial for place, trial in state.refused.items() if place not in now.rivals]
    now.tried = [_accepted(now, term) for term in now.terms] + sorted(refused, key=lambda t: -t.gain)
    now.curved = with_curves(state, now)
    return now


def _found(state: SearchState, terms: Sequence[Term]) -> Solution:
    """Run the search from the given terms."""
    state.changed(None)
    now = drop_needless(state, reweigh(state, solve(state, terms))) if terms else plain_terms(state, solve(state, []))
    while len(now.terms) < state.thresholds.most and not state.spent() and (entered := enter(state, now)) is not None:
        now = reweigh(state, entered)
        now = swap(state, now, beside=now.terms[-1])
        now = drop_needless(state, now, beside=now.terms[-1])
    now = drop_needless(state, swap(state, now))
    for term in steps(now.terms[:-1], "refining", title):
        if not state.spent():
            now = refine(state, now, term)
    now = _checked(state, now)
    # A removed term may have replaced one that every arm has.
    again = plain_terms(state, now)
    return now if again.terms == now.terms else _checked(state, again)


def _checked(state: SearchState, now: Solution) -> Solution:
    now = drop_needless(state, now)
    for drop in steps(CHECKS, "checking the terms"):
        now = drop(state, now)
    return now


def _rivals(state: SearchState, now: Solution) -> dict[Place, tuple[float, tuple[Candidate, ...]]]:
    """Evidence of each term beside the others, and of the best names in its place."""
    out = {}
    for term in steps(now.terms, "other names for", title):
        _, own, found = rivals(state, now, term)
        out[term.place] = own, tuple(found[:RIVALS])
    return out


def _accepted(now: Solution, term: Term) -> Trial:
    gain, others = now.rivals[term.place]
    best = f"{others[0].term.effect.name} in its place: {others[0].gain:.0f}" if others else "no other name fits"
    return Trial.of(term, gain, True, best)
