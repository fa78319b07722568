"""Forward steps: the best candidate is added, and each term is tried under every other name."""

from __future__ import annotations

from collections import Counter

from cellwatt.progress import steps
from cellwatt_plugins.explain.fit.acceptance import collinear, physical, rejection, unset
from cellwatt_plugins.explain.fit.problem import Term, title
from cellwatt_plugins.explain.fit.search.backward import shares_channel
from cellwatt_plugins.explain.fit.search.candidates import candidates, rivals
from cellwatt_plugins.explain.fit.search.refine import refine
from cellwatt_plugins.explain.fit.search.solve import solve, without
from cellwatt_plugins.explain.fit.search.state import SearchState
from cellwatt_plugins.explain.fit.solution import Solution

BEST, USUAL = 2, 5
"""Largest number of candidates per joint (or whole arm) that are fitted in a step; the second for usual effects."""
RIVALS = 3
"""Largest number of other names fitted in a term's place."""
AHEAD = 3.0
"""nats by which the evidence of a name must exceed that of the name it replaces."""


def enter(state: SearchState, now: Solution) -> Solution | None:
    """The solution with the best new term; None if none is accepted."""
    looked_at: Counter[int | None] = Counter()
    skipped: set[int | None] = set()
    for candidate in steps(candidates(state, now), "fitting", lambda candidate: title(candidate.term)):
        if candidate.gain < state.thresholds.least:
            state.refuse(candidate.term, candidate.gain, "adds too little evidence")
            continue
        if looked_at[candidate.term.joint] >= (USUAL if candidate.term.effect.usual else BEST):
            state.refuse(candidate.term, candidate.gain, "rivals of the same place with more evidence were refused")
            state.unsearched.discard(candidate.term.joint)
            continue
        if state.spent():
            state.refuse(candidate.term, candidate.gain, "was not fitted: the time limit was reached")
            skipped.add(candidate.term.joint)
            continue
        looked_at[candidate.term.joint] += 1
        new = refine(state, solve(state, [*now.terms, candidate.term]), candidate.term)
        if (like := collinear(now, new, state.thresholds.blur)) is not None:
            if (instead := _instead(state, now, like, new.terms[-1])) is not None:
                state.changed(like.joint, candidate.term.joint)
                return instead
            why: str | None = f"cannot be distinguished from {like.effect.name.replace('_', ' ')} in these recordings"
        else:
            why = rejection(now, new, state.thresholds, candidate.gain)
        if why is None:
            state.changed(candidate.term.joint)
            return new
        state.refuse(candidate.term, candidate.gain, why)
    state.unsearched &= skipped
    return None


def _instead(state: SearchState, now: Solution, old: Term, new: Term) -> Solution | None:
    """The solution with a new term in place of an old one; None if the old one has more evidence."""
    others = without(state, now, old)
    own, other = (others.fit.gain(others.problem.block(t))[0] + t.effect.relations.plainer for t in (old, new))
    if other < own + AHEAD:
        return None
    state.refuse(old, own, f"{new.effect.name} explains it better")
    return solve(state, [*others.terms, new])


def swap(state: SearchState, now: Solution, beside: Term | None = None) -> Solution:
    """Each term under the name that explains it best, with the others fixed; only terms that share a channel with
    ``beside``."""
    for term in steps(list(now.terms), "other names for", title):
        if not shares_channel(term, beside):
            continue
        if state.spent():
            break
        others, own, found = rivals(state, now, term)
        for rival in found[:RIVALS]:
            ahead = rival.term.effect.relations.plainer - term.effect.relations.plainer
            if rival.gain + ahead < own - AHEAD:
                continue
            new = refine(state, solve(state, [*others.terms, rival.term]), rival.term)
            gain = others.fit.gain(new.problem.block(new.terms[-1]))[0]
            if gain + ahead > own + AHEAD and rejection(others, new, state.thresholds, gain) is None:
                state.refuse(term, own, f"{new.terms[-1].effect.name} explains it better")
                now, own = new, gain
        if term in now.terms and (instead := _rotors(state, others, own, term)) is not None:
            state.refuse(term, own, "the rotors that the description lacks explain it as well")
            now = instead
    return now


def _rotors(state: SearchState, others: Solution, own: float, link: Term) -> Solution | None:
    """The solution with rotors in place of a link's error of evidence ``own``; None if they explain less.

    The error of a link can stand for the rotors of its joint and of those before it, of which none alone replaces it.
    """
    if link.effect.acts_on != "links" or link.joint is None:
        return None
    joints = [joint for joint in range(link.joint, -1, -1) if joint in state.moving]
    rotors = [Term(e, joint, ()) for e in state.effects if e.name == "rotor_inertia" for joint in joints]
    known = {term.place for term in others.terms}
    new, gain, count = others, 0.0, 0
    for term in (rotor for rotor in rotors if unset(rotor, state.robot) and rotor.place not in known):
        added, mean = new.fit.gain(new.problem.block(term))
        if physical(term, mean, state.robot):
            new, gain, count = solve(state, [*new.terms, term]), gain + added, count + 1
    return new if count and gain > own - count * AHEAD else None
