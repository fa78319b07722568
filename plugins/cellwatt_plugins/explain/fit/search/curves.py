"""What is left at a joint, as a curve of what it goes with; and laws whose form such a curve gives the lie."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt_plugins.explain.fit.leave_out import LeaveOut, compared
from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.explain.fit.search.solve import solve, without
from cellwatt_plugins.explain.fit.search.state import SearchState
from cellwatt_plugins.explain.fit.solution import Solution
from cellwatt_plugins.robot.curves import CURVE, CURVES, Curve

EXCESS = 0.35
"""Mean square residual beyond noise from which a curve of it is looked for."""
SHARE, SURE = 0.08, 2.0
"""Share of a joint's mean square error on data left out, and standard errors, that a curve must take off."""
BESIDE = 0.5
"""Share of what a law takes off that a free curve of the same course may take off beside it."""
EACH = 2
"""Curves of a joint at most."""


def with_curves(state: SearchState, now: Solution) -> Solution:
    """The solution with curves at the joints where data left out confirm them."""
    if now.problem.side == "supply":
        return now
    for joint in state.moving:
        for _ in range(EACH):
            if now.problem.chi2(now.residual)[joint] - 1 < EXCESS or (new := _best(state, now, joint)) is None:
                break
            now = new
    return now


def _best(state: SearchState, now: Solution, joint: int) -> Solution | None:
    before = LeaveOut(now.problem, now.factor).errors(now.terms)
    best, least = None, 0.0
    for curve in CURVES:
        term = _term(now, curve, joint)
        if term is None or any(t.place == term.place for t in now.terms):
            continue
        found = compared(before, LeaveOut(now.problem, now.factor).errors([*now.terms, term]), [joint])
        if found.share > max(SHARE, least) and found.sure > SURE and found.rise < state.thresholds.rise:
            best, least = term, found.share
    return None if best is None else solve(state, [*now.terms, best])


def drop_ill_formed(state: SearchState, now: Solution) -> Solution:
    """Laws leave beside which a free curve of the same course takes off nearly as much as they do."""
    for term in [t for t in now.terms if t.effect.relations.along]:
        curve = _term(now, CURVE[f"{term.effect.relations.along}_curve"], term.joint or 0)
        if curve is None:
            continue
        held, rest = LeaveOut(now.problem, now.factor), without(state, now, term)
        joint = [term.joint or 0]
        bare, own, both = (held.errors(t) for t in (rest.terms, now.terms, [*now.terms, curve]))
        law, beyond = float(np.sum((bare - own)[:, joint])), float(np.sum((own - both)[:, joint]))
        # Where loosened links can stand for a law, what it takes off tells nothing of its form.
        if law > 0 and beyond > BESIDE * law and compared(own, both, joint).sure > SURE:
            share = 100 * beyond / (law + beyond)
            why = f"has not this form: {share:.0f} % of it is another curve of the {term.effect.relations.along}"
            state.refuse(term, 0.0, why)
            now = rest
    return now


def _term(now: Solution, curve: Curve, joint: int) -> Term | None:
    shapes: Sequence[tuple[float, ...]] = curve.shapes(now.problem.states, joint, ())
    return Term(curve, joint, shapes[0]) if shapes else None
