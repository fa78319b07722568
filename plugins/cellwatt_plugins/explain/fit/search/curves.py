"""The residual of a joint as a curve of a quantity, and laws that such a curve disproves."""

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
"""Mean square residual beyond noise, in units of the noise, above which a curve is searched."""
SHARE, SURE = 0.08, 2.0
"""Share of a joint's mean square error on data left out, and standard errors, that a curve must remove."""
BESIDE = 0.5
"""Largest error that a free curve of the same quantity may remove beside a law, as a share of what the law removes."""
EACH = 2
"""Largest number of curves per joint."""


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
    """Remove laws beside which a free curve of the same quantity removes about as much error as they do."""
    for term in [t for t in now.terms if t.effect.relations.along]:
        curve = _term(now, CURVE[f"{term.effect.relations.along}_curve"], term.joint or 0)
        if curve is None:
            continue
        held, rest = LeaveOut(now.problem, now.factor), without(state, now, term)
        joint = [term.joint or 0]
        bare, own, both = (held.errors(t) for t in (rest.terms, now.terms, [*now.terms, curve]))
        law, beyond = float(np.sum((bare - own)[:, joint])), float(np.sum((own - both)[:, joint]))
        # Where loosened links can replace a law, the error that it removes says nothing about its form.
        if law > 0 and beyond > BESIDE * law and compared(own, both, joint).sure > SURE:
            share = 100 * beyond / (law + beyond)
            why = f"does not have this form: {share:.0f} % of it is another curve of the {term.effect.relations.along}"
            state.refuse(term, 0.0, why)
            now = rest
    return now


def _term(now: Solution, curve: Curve, joint: int) -> Term | None:
    shapes: Sequence[tuple[float, ...]] = curve.shapes(now.problem.states, joint, ())
    return Term(curve, joint, shapes[0]) if shapes else None
