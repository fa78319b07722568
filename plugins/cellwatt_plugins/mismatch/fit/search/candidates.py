"""The candidates of a step: every effect at every place, each with its best shape, beside the terms already there."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cellwatt.progress import steps
from cellwatt_plugins.mismatch.fit.acceptance import physical, within_prior
from cellwatt_plugins.mismatch.fit.problem import Term
from cellwatt_plugins.mismatch.fit.search.state import SearchState
from cellwatt_plugins.mismatch.fit.solution import Candidate, Solution
from cellwatt_plugins.robot.blocks import Block
from cellwatt_plugins.robot.effects.effect import Effect, Shape

Float = NDArray[np.float64]

SAME_LOAD = 0.05
"""Share by which a load may change before what swings under it is simulated anew."""


def candidates(state: SearchState, now: Solution, at: int | None = None) -> list[Candidate]:
    """Return what each effect would add, greatest evidence first; at joint ``at`` only, where it is given.

    What was found at joints of which no term has changed since is as it was.
    """
    chi2 = now.problem.fast_chi2(now.residual)
    places = [
        (effect, joint)
        for effect in state.effects
        for joint in _places(state, effect)
        if (at is None or joint == at or (joint is None and effect.acts_on != "reading"))
        and _open(state, now, effect, joint, chi2)
    ]
    known = state.known(now.terms) if at is None else {}
    out = []
    for effect, joint in steps(places, "trying", lambda place: place[0].name.replace("_", " ")):
        key = effect.name, joint
        if key not in known:
            known[key] = _tried(state, now, effect, joint)
        out.append(known[key])
    return sorted((c for c in out if c is not None), key=lambda c: -c.gain - c.term.effect.relations.plainer)


def _tried(state: SearchState, now: Solution, effect: Effect, joint: int | None) -> Candidate | None:
    """An effect at a place with its best shape."""
    shapes = effect.shapes(now.problem.states, joint, state.every_sample(now))
    return _best_shape(state, now, effect, joint, shapes)


def has_friction(state: SearchState, joint: int | None, terms: Sequence[Term]) -> bool:
    """True if there is Coulomb friction that an effect could change."""
    described = state.robot.column("coulomb_friction")[joint or 0]
    return bool(described > 0) or any(t.place == ("coulomb_friction", joint) for t in terms)


def _places(state: SearchState, effect: Effect) -> list[int | None]:
    """Joints (0-based), or None for the robot or the supply, at which the simulation may lack an effect."""
    states = state.problem.states
    if min(1 / s.step for s in states) < effect.acceptance.least_rate:
        return []
    if max(float(s.time[-1] - s.time[0]) for s in states) < effect.acceptance.longest_run:
        return []
    places: list[int | None] = list(state.moving) if effect.place == "joint" else [None]
    if effect.form.intermittent and effect.place == "joint":
        places = list(range(states[0].arm.body.joints))
    return [joint for joint in places if effect.possible(state.robot, joint)]


def _open(state: SearchState, now: Solution, effect: Effect, joint: int | None, fast_chi2: Float) -> bool:
    """True if an effect is worth a try beside the terms that are there."""
    if any(t.joint == joint and _stands_for(t.effect, effect) for t in now.terms):
        return False
    if effect.form.sample_by_sample and joint is not None and fast_chi2[joint] <= state.thresholds.costly:
        return False
    return effect.acts_on != "friction" or has_friction(state, joint, now.terms)


def _stands_for(one: Effect, other: Effect) -> bool:
    family = other.relations.family
    return one is other or (family != "" and one.relations.family == family)


def _best_shape(
    state: SearchState, now: Solution, effect: Effect, joint: int | None, shapes: Sequence[Shape]
) -> Candidate | None:
    """The shape with the greatest evidence; None where the recordings resolve none or no coefficients can be."""
    states = now.problem.states
    terms = [Term(effect, joint, shape) for shape in shapes if effect.resolved(states, joint, shape)]
    if not terms:
        return None
    blocks = _blocks(state, now, effect, joint, terms)
    gains = now.fit.gains(blocks, keep=effect.by_motion_alone)
    found = [
        Candidate(term, gain - effect.charge(states, term.shape), coefficients)
        for term, block, (gain, coefficients) in zip(terms, blocks, gains, strict=True)
        if physical(term, coefficients, state.robot) and within_prior(term, coefficients, block.prior)
    ]
    return max(found, key=lambda c: c.gain, default=None)


def _blocks(state: SearchState, now: Solution, effect: Effect, joint: int | None, terms: Sequence[Term]) -> list[Block]:
    """Blocks of all shapes of an effect; made once for a motion, and costly ones for a load."""
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
