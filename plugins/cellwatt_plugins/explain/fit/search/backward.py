"""Backward elimination: reasons for which a term is removed again."""

from __future__ import annotations

import numpy as np

from cellwatt_plugins.explain.fit.acceptance import (
    felt,
    held,
    relieves_tension,
    required_gain,
    seen_by_several,
    sound,
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
"""Largest additional stretch of nominal parameters, in nats, with which a plainer name may replace a term."""
LEFT, COMPLETE = 1.3, 0.9
"""A term completes the explanation if a plainer name leaves a mean square residual above ``LEFT``, in units of the
noise, and the term removes the share ``COMPLETE`` of it beyond the noise."""
UNSURE = 0.65
"""Share of a term's evidence above which a quite different shape fits about as well."""


def drop_needless(state: SearchState, now: Solution, beside: Term | None = None) -> Solution:
    """Remove terms that others made unnecessary; with ``beside``, only terms that ``beside`` can replace."""
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
            state.refuse(term, gain, "is not needed beside the others")
            now = rest
    return now


def drop_within_model_error(state: SearchState, now: Solution) -> Solution:
    """Remove terms whose contribution is smaller than the possible model error of another term."""
    one_channel = now.problem.side == "supply"
    for term in list(now.terms):
        beside = [t for t in now.terms if t is not term and (one_channel or shares_channel(term, t))]
        doubt = {t.effect.name: t.effect.form.error * _size(now, t) for t in beside}
        name = max(doubt, key=lambda n: doubt[n], default="")
        if name and _size(now, term) < doubt[name]:
            state.refuse(term, 0.0, f"is smaller than the possible model error of {name.replace('_', ' ')}")
            now = without(state, now, term)
    return now


def drop_for_plainer(state: SearchState, now: Solution) -> Solution:
    """Remove terms for which a plainer name does as well on data left out; add the plainer name if it is confirmed."""
    effects = {effect.name: effect for effect in state.effects}
    for term in list(now.terms):
        rest, present = without(state, now, term), {t.place for t in now.terms}
        for name in term.effect.relations.beats:
            if name not in effects or (name, term.joint) in present:
                continue
            if state.powered and term.effect.acts_on == "friction" and effects[name].acts_on == "reading":
                continue
            plain = solve(state, [*rest.terms, Term(effects[name], term.joint, ())])
            if not sound(plain, plain.terms[-1]):
                continue
            # A plainer name may fit only because nominal parameters are stretched for it.
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
    """True if the term removes nearly all of a joint's residual beyond the noise that the plainer name leaves."""
    before, after = (float(s.problem.chi2(s.residual)[joint]) for s in (plain, now))
    return before > LEFT and before - after > COMPLETE * (before - 1)


def drop_ambiguous(state: SearchState, now: Solution) -> Solution:
    """Remove terms that fit about as well with a quite different shape."""
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
            state.refuse(term, own[0], f"its shape could equally be {best.shape[0]:.3g} instead of {term.shape[0]:.3g}")
            now = rest
    return now


def drop_unconfirmed(state: SearchState, now: Solution) -> Solution:
    """Remove terms that data left out do not confirm beside the others."""
    for term in _weakest_first(now):
        rest = without(state, now, term)
        gain = rest.fit.gain(rest.problem.block(term))[0]
        why = unconfirmed(rest, now, term, state.thresholds, gain)
        if not sound(now, term):
            why = "has a value that is not physical"
        several = not term.effect.acceptance.several_channels or relieves_tension(rest, now, state.thresholds)
        if why is None and not several and not seen_by_several(rest, now.block(term)[0]):
            why = "is supported by one channel only"
        if why is None and _murky(state, rest, now, term):
            why = "removes little, or not surely, from a channel with a large unexplained residual"
        if why is None and _as_friction(state, now, term):
            why = "is not stronger than the friction of its joint"
        if why is None and _as_blow(now, term):
            why = "may equally be a blow in the play of its joint"
        if why is None and not felt(rest, now, term, state.thresholds):
            why = "removes little of the error of any joint"
        if why is None and not stands_out(rest, now, term, state.thresholds):
            why = "is small beside the residual of its channels"
        if why is not None:
            state.refuse(term, gain, f"beside the others {why}")
            now = rest
    return now


def _as_friction(state: SearchState, now: Solution, term: Term) -> bool:
    """True for an intermittent term of a motion without a plan that is not stronger than its joint's friction."""
    if term.joint is None or not term.effect.form.intermittent or not now.problem.states[0].unplanned:
        return False
    friction = state.turning[term.joint] + state.robot.column("coulomb_friction")[term.joint]
    return bool(np.max(np.abs(now.added(term))) < friction)


def _as_blow(now: Solution, term: Term) -> bool:
    """True for an intermittent term at a joint with backlash, whose blows no model predicts."""
    plays = any(t.joint == term.joint and t.effect.name == "backlash" for t in now.terms)
    return term.joint is not None and term.effect.form.intermittent and plays


def _murky(state: SearchState, rest: Solution, now: Solution, term: Term) -> bool:
    """True if a term removes little, or not surely, from a joint with a large residual of unknown origin.

    Excluded are effects that ring or clack, which never reach the noise, and intermittent ones.
    """
    thresholds, form = state.thresholds, term.effect.form
    certain = np.isfinite(term.effect.acceptance.by_evidence)
    if term.joint is None or form.intermittent or form.sample_by_sample or certain:
        return False
    if now.problem.chi2(now.residual)[term.joint] < thresholds.much_left or relieves_tension(rest, now, thresholds):
        return False
    found = held(rest, now, term)
    sure = thresholds.steady if unset(term, state.robot) else thresholds.sure
    return found.share < thresholds.murky or found.sure < sure


def shares_channel(term: Term, other: Term | None) -> bool:
    """True if two terms act on a common channel; with None, always."""
    return other is None or None in (term.joint, other.joint) or term.joint == other.joint


def _weakest_first(now: Solution) -> list[Term]:
    """The terms by their evidence beside all others: of two that can replace each other, the weaker is tested first."""
    return sorted(now.terms, key=lambda t: now.fit.added(now.block(t)[1]) + t.effect.relations.plainer)


def _size(now: Solution, term: Term) -> float:
    """Rms contribution of a term, in units of the noise."""
    return float(np.sqrt(np.mean(np.square(now.added(term) / now.problem.floor))))
