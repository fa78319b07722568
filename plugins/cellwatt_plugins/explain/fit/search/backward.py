"""Backward elimination: what makes a term leave that once entered."""

from __future__ import annotations

import numpy as np

from cellwatt_plugins.explain.fit.acceptance import (
    felt,
    held,
    physical,
    relieves_tension,
    required_gain,
    seen_by_several,
    stands_out,
    tension,
    unconfirmed,
    unset,
)
from cellwatt_plugins.explain.fit.leave_out import LeaveOut, compared
from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.explain.fit.search.candidates import has_friction
from cellwatt_plugins.explain.fit.search.solve import solve, without
from cellwatt_plugins.explain.fit.search.state import SearchState
from cellwatt_plugins.explain.fit.solution import Solution

STRETCHED = 5.0
"""nats that the tolerances of nominal numbers give a name before a plainer one."""
LEFT, COMPLETE = 1.3, 0.9
"""Mean square residual that a plainer name leaves, and the share of it beyond the noise that one takes off that says
all there is to say."""
UNSURE = 0.65
"""Share of a term's evidence from which a quite different shape of it fits about as well."""


def drop_needless(state: SearchState, now: Solution, beside: Term | None = None) -> Solution:
    """Terms that others made needless leave; only those that ``beside`` can stand for, where it is given."""
    for term in _weakest_first(now):
        if term is beside or not shares_channel(term, beside):
            continue
        if beside is not None and term.effect.usual and term.joint != beside.joint:
            continue
        others = [t for t in now.terms if t is not term]
        shaping = any(t.joint == term.joint and t.effect.acts_on == "friction" for t in others)
        if shaping and not has_friction(state, term.joint, others):
            continue
        rest = solve(state, others)
        gain = rest.fit.gain(now.problem.block(term))[0]
        small = gain < required_gain(term, state.robot, state.thresholds)
        if small and unconfirmed(rest, now, term, state.thresholds, gain) is not None:
            state.refuse(term, gain, "needless beside the others")
            now = rest
    return now


def drop_within_model_error(state: SearchState, now: Solution) -> Solution:
    """Terms that add less than the form of another one there may be wrong by leave."""
    one_channel = now.problem.side == "supply"
    for term in list(now.terms):
        beside = [t for t in now.terms if t is not term and (one_channel or shares_channel(term, t))]
        doubt = {t.effect.name: t.effect.form.error * _size(now, t) for t in beside}
        name = max(doubt, key=lambda n: doubt[n], default="")
        if name and _size(now, term) < doubt[name]:
            state.refuse(term, 0.0, f"is less than the form of {name.replace('_', ' ')} may be wrong by")
            now = without(state, now, term)
    return now


def drop_for_plainer(state: SearchState, now: Solution) -> Solution:
    """Terms leave in whose place a plainer one does as well on data left out; it comes in where it holds by itself."""
    effects = {effect.name: effect for effect in state.effects}
    for term in list(now.terms):
        rest, there = without(state, now, term), {t.place for t in now.terms}
        for name in term.effect.relations.beats:
            if name not in effects or (name, term.joint) in there:
                continue
            if state.powered and term.effect.acts_on == "friction" and effects[name].acts_on == "reading":
                continue
            plain = solve(state, [*rest.terms, Term(effects[name], term.joint, ())])
            if not physical(plain.terms[-1], plain.coefficients(plain.terms[-1]), state.robot):
                continue
            # Nominal numbers that are stretched for it take up what the plainer name does not say.
            if np.sum(tension(plain)) - np.sum(tension(now)) > 2 * STRETCHED:
                continue
            bare, old, new = (LeaveOut(s.problem, now.factor).errors(s.terms) for s in (rest, plain, now))
            joint = [term.joint or 0]
            beyond, alone = compared(old, new, joint), float(np.sum((bare - new)[:, joint]))
            share = float(np.sum((old - new)[:, joint])) / alone if alone > 0 else 0.0
            little = share < state.thresholds.better and not _completes(plain, now, joint[0])
            if little or beyond.sure < state.thresholds.steady:
                gain = rest.fit.gain(rest.problem.block(term))[0]
                state.refuse(term, gain, f"is no better than {name.replace('_', ' ')} on data left out")
                now = rest if unconfirmed(rest, plain, plain.terms[-1], state.thresholds, gain) else plain
                break
    return now


def _completes(plain: Solution, now: Solution, joint: int) -> bool:
    """True if hardly anything is left of what the plainer name leaves at a joint beyond the noise."""
    before, after = (float(s.problem.chi2(s.residual)[joint]) for s in (plain, now))
    return before > LEFT and before - after > COMPLETE * (before - 1)


def drop_ambiguous(state: SearchState, now: Solution) -> Solution:
    """Terms leave whose shape could as well be quite another one."""
    for term in list(now.terms):
        rivals = [
            Term(term.effect, term.joint, s) for s in term.effect.unlike(now.problem.states, term.joint, term.shape)
        ]
        if not rivals:
            continue
        rest = without(state, now, term)
        own, *others = rest.fit.gains([rest.problem.block(t) for t in (term, *rivals)])
        if max(gain for gain, _ in others) > UNSURE * own[0]:
            best = max(zip(others, rivals, strict=True), key=lambda each: each[0][0])[1]
            state.refuse(term, own[0], f"its shape is as well {best.shape[0]:.3g} as {term.shape[0]:.3g}")
            now = rest
    return now


def drop_unconfirmed(state: SearchState, now: Solution) -> Solution:
    """Terms that data left out do not confirm beside the others leave."""
    for term in _weakest_first(now):
        rest = without(state, now, term)
        gain = rest.fit.gain(rest.problem.block(term))[0]
        why = unconfirmed(rest, now, term, state.thresholds, gain)
        if not physical(term, now.coefficients(term), state.robot):
            why = "is not possible as it is"
        several = not term.effect.acceptance.several_channels or relieves_tension(rest, now, state.thresholds)
        if why is None and not several and not seen_by_several(rest, now.block(term)[0]):
            why = "only one channel asks for it"
        if why is None and _murky(state, rest, now, term):
            why = "takes little, or not surely, off a channel of which much stays unexplained"
        if why is None and _as_friction(state, now, term):
            why = "is less than friction may pull either way"
        if why is None and _as_blow(now, term):
            why = "is as well a blow in the play there"
        if why is None and not felt(rest, now, term, state.thresholds):
            why = "takes little off the error of every joint"
        if why is None and not stands_out(rest, now, term, state.thresholds):
            why = "is small beside what is left there"
        if why is not None:
            state.refuse(term, gain, f"beside the others {why}")
            now = rest
    return now


def _as_friction(state: SearchState, now: Solution, term: Term) -> bool:
    """True of what is there once, of a motion without a plan, and no stronger than the friction of its joint."""
    if term.joint is None or not term.effect.form.intermittent or not now.problem.states[0].unplanned:
        return False
    friction = state.turning[term.joint] + state.robot.column("coulomb_friction")[term.joint]
    return bool(np.max(np.abs(now.added(term))) < friction)


def _as_blow(now: Solution, term: Term) -> bool:
    """True of what is there once, at a joint whose link rebounds in its play: no blow of it is foretold."""
    plays = any(t.joint == term.joint and t.effect.name == "backlash" for t in now.terms)
    return term.joint is not None and term.effect.form.intermittent and plays


def _murky(state: SearchState, rest: Solution, now: Solution, term: Term) -> bool:
    """True if a term takes little off its joint, or not surely, beside what is in no library.

    What rings or clacks is never followed to the noise, and what is there at times only is not left out.
    """
    asked, form = state.thresholds, term.effect.form
    certain = np.isfinite(term.effect.acceptance.by_evidence)
    if term.joint is None or form.intermittent or form.sample_by_sample or certain:
        return False
    if now.problem.chi2(now.residual)[term.joint] < asked.much_left or relieves_tension(rest, now, asked):
        return False
    found = held(rest, now, term)
    sure = asked.steady if unset(term, state.robot) else asked.sure
    return found.share < asked.murky or found.sure < sure


def shares_channel(term: Term, other: Term | None) -> bool:
    """True if two terms act on a common channel; with None, always."""
    return other is None or None in (term.joint, other.joint) or term.joint == other.joint


def _weakest_first(now: Solution) -> list[Term]:
    """The terms by their evidence beside all others: of two that stand for one another the weaker is asked first."""
    return sorted(now.terms, key=lambda t: now.fit.added(now.block(t)[1]) + t.effect.relations.plainer)


def _size(now: Solution, term: Term) -> float:
    """Size of what a term adds, in units of the noise."""
    return float(np.sqrt(np.mean(np.square(now.added(term) / now.problem.floor))))
