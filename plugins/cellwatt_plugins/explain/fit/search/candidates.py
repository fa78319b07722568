"""The candidates of a step: every effect at every joint, each with its best shape, beside the current terms."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.progress import steps
from cellwatt_plugins.explain.fit.acceptance import physical, within_prior
from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.explain.fit.search.solve import without
from cellwatt_plugins.explain.fit.search.state import SearchState
from cellwatt_plugins.explain.fit.solution import Candidate, Solution
from cellwatt_plugins.robot.blocks import Block
from cellwatt_plugins.robot.effects.effect import Effect

MOSTLY = 0.5
"""Share of a joint's residual beyond the noise that must be fast for effects that ring or clack to be tried."""
SAME_LOAD = 0.05
"""Relative change of a load above which the effects that swing under it are simulated again."""


def candidates(state: SearchState, now: Solution) -> list[Candidate]:
    """The evidence that each effect would add, greatest first."""
    return _ordered(state, now, now, lambda effect, joint: True)


def rivals(state: SearchState, now: Solution, term: Term) -> tuple[Solution, float, list[Candidate]]:
    """The solution without a term, the term's evidence beside it, and the candidates in its place, best first.

    Candidates are the effects at its joint, and effects of the whole arm that can look the same; after the time limit,
    only those that cost little.
    """
    others, spent = without(state, now, term), state.spent()
    alike = {confusion.effect for confusion in term.effect.confusions}

    def rival(effect: Effect, joint: int | None) -> bool:
        if spent and not effect.by_motion_alone:
            return False
        return term.joint is None or joint == term.joint or (joint is None and effect.name in alike)

    # A term that leaves no fast residual has no rival among effects that ring or clack.
    fast = others if term.effect.form.sample_by_sample else now
    own = others.fit.gain(others.problem.block(term))[0]
    return others, own, [c for c in _ordered(state, others, fast, rival) if c.term.place != term.place]


def _ordered(
    state: SearchState, now: Solution, fast: Solution, chosen: Callable[[Effect, int | None], bool]
) -> list[Candidate]:
    """Candidates at the joints for which ``chosen`` is true; results for the same terms are reused."""
    quick, every = fast.problem.fast_chi2(fast.residual) - 1, fast.problem.chi2(fast.residual) - 1
    rings = (quick > state.thresholds.costly - 1) & (quick > MOSTLY * every)
    places = [
        (effect, joint)
        for effect in state.effects
        for joint in _places(state, effect)
        if chosen(effect, joint) and _open(state, now, effect, joint, rings)
    ]
    out, residual = [], now.problem.every_sample(now.residual)
    for effect, joint in steps(places, "trying", lambda place: place[0].name.replace("_", " ")):
        own = frozenset(t for t in now.terms if joint is None or t.joint in (None, joint))
        key = effect.name, joint, own
        if key not in state.known:
            state.known[key] = _best_shape(state, now, residual, effect, joint)
        out.append(state.known[key])
    return sorted((c for c in out if c is not None), key=lambda c: -c.gain - c.term.effect.relations.plainer)


def has_friction(state: SearchState, joint: int | None, terms: Sequence[Term]) -> bool:
    """True if the joint has Coulomb friction that an effect could change."""
    described = state.robot.column("coulomb_friction")[joint or 0]
    return bool(described > 0) or any(t.place == ("coulomb_friction", joint) for t in terms)


def _places(state: SearchState, effect: Effect) -> list[int | None]:
    """Joints (0-based), or None for the robot or the supply, at which the simulation may lack an effect."""
    states = state.problem.states
    if min(1 / s.step for s in states) < effect.acceptance.least_rate:
        return []
    if effect.acceptance.exact_times and not all(s.exact_times for s in states):
        return []
    if max(float(s.time[-1] - s.time[0]) for s in states) < effect.acceptance.longest_run:
        return []
    places: list[int | None] = list(state.moving) if effect.place == "joint" else [None]
    if effect.form.intermittent and effect.place == "joint":
        places = list(range(states[0].arm.body.joints))
    return [joint for joint in places if effect.possible(state.robot, joint)]


def _open(state: SearchState, now: Solution, effect: Effect, joint: int | None, rings: NDArray[np.bool_]) -> bool:
    """True if an effect is worth trying beside the current terms; sample-by-sample effects only at joints that ring
    (``rings``)."""
    if any(t.joint == joint and _stands_for(t.effect, effect) for t in now.terms):
        return False
    if effect.form.sample_by_sample and joint is not None and not rings[joint]:
        return False
    return effect.acts_on != "friction" or has_friction(state, joint, now.terms)


def _stands_for(one: Effect, other: Effect) -> bool:
    family = other.relations.family
    return one is other or (family != "" and one.relations.family == family)


def _best_shape(
    state: SearchState, now: Solution, residual: Sequence[Float], effect: Effect, joint: int | None
) -> Candidate | None:
    """The shape with the greatest evidence; None if the recordings resolve none or no coefficients are possible.

    ``residual`` (N, C) of each run is that of ``now`` at all samples.
    """
    states = now.problem.states
    shapes = effect.shapes(states, joint, residual)
    terms = [Term(effect, joint, shape) for shape in shapes if effect.resolved(states, joint, shape)]
    if not terms:
        return None
    blocks = _blocks(state, now, effect, joint, terms)
    gains = now.fit.gains(blocks, keep=effect.by_motion_alone)
    found = [
        Candidate(term, gain - effect.charge(states, term.shape))
        for term, block, (gain, coefficients) in zip(terms, blocks, gains, strict=True)
        if physical(term, coefficients, state.robot) and within_prior(term, coefficients, block.prior)
    ]
    return max(found, key=lambda c: c.gain, default=None)


def _blocks(state: SearchState, now: Solution, effect: Effect, joint: int | None, terms: Sequence[Term]) -> list[Block]:
    """Blocks of all shapes of an effect; computed once per motion, and for costly effects once per load."""
    key, problem = (effect.name, joint), now.problem
    costly = effect.form.sample_by_sample and effect.depends_on == "load"
    load = np.concatenate([s.load[:, joint or 0] for s in problem.states]) if costly else np.zeros(0)
    old = state.loads.get(key, np.zeros(0))
    if key in state.blocks and (not costly or np.std(load - old) < SAME_LOAD * np.std(old)):
        return state.blocks[key]
    per_run = [effect.grid(s, joint, [t.shape for t in terms]) for s in problem.states]
    blocks = [problem.prior_block(t, problem.stack([run[i] for run in per_run])) for i, t in enumerate(terms)]
    if effect.by_motion_alone or costly:
        state.blocks[key], state.loads[key] = blocks, load
    return blocks
