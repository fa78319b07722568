"""From the solutions of both sides to one model with estimates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.problem import Place, Problem, Term
from cellwatt_plugins.explain.fit.solution import Solution
from cellwatt_plugins.explain.fit.swinging_links import confirmed_share
from cellwatt_plugins.explain.input.baseline import Baseline
from cellwatt_plugins.explain.model import FittedTerm, Model, Retuned
from cellwatt_plugins.robot.blocks import Block, Regression
from cellwatt_plugins.robot.effects.effect import Estimate
from cellwatt_plugins.robot.regression import Prior


def model_of(torque: Solution, supply: Solution | None, base: Baseline) -> Model:
    """The model that both solutions give, added to ``base``."""
    terms = [FittedTerm(term, _foreseen(torque, term)) for term in torque.terms]
    if supply is not None:
        terms += [FittedTerm(term, supply.coefficients(term)) for term in supply.terms]
    return Model(base, retuned(torque, supply), tuple(terms))


def _foreseen(solution: Solution, term: Term) -> Float:
    """Coefficients of a term; for a term simulated sample by sample, reduced to the share that other runs confirm."""
    own = solution.coefficients(term)
    if not term.effect.form.sample_by_sample:
        return own
    return np.asarray(own * confirmed_share(solution.problem, term, own, solution.residual))


def retuned(torque: Solution, supply: Solution | None) -> Retuned:
    """Corrections of the nominal parameters from the fits."""
    found = {
        (number.name, number.joint): solution.fit.coefficients[place]
        for solution in (torque, supply)
        if solution is not None
        for number, place in zip(solution.problem.nuisance, solution.problem.design.slices, strict=True)
    }
    joints = range(len(torque.problem.states[0].robot.joints))

    def one(name: str, joint: int | None) -> float:
        return float(found[name, joint][0]) if (name, joint) in found else 0.0

    return Retuned(
        np.concatenate([found["link", joint] for joint in joints]),
        np.array([one("coulomb_friction", joint) for joint in joints]),
        np.array([one("viscous_friction", joint) for joint in joints]),
        np.array([one("rotor_inertia", joint) for joint in joints]),
        one("standby_power", None),
        np.array([one("winding_resistance", joint) for joint in joints]),
    )


def estimates(solution: Solution) -> dict[Place, Estimate]:
    """Coefficients and shapes of each term with their joint covariance: Gauss-Newton around the solution."""
    blocks, slopes = list(solution.fit.blocks), []
    for term in solution.terms:
        block, place = solution.block(term)
        slope = _slopes(solution.problem, term, solution.fit.coefficients[place])
        slopes.append(None if slope is None else len(blocks))
        if slope is not None:
            typical = np.array([max(abs(term.shape[i]), 1e-6) for i in _refined(term)])
            blocks.append(Block(slope, block.channel, Prior.spread(1e3 * typical)))
    # Parameters that keep the user's values are not more certain for that.
    design = (solution.free or solution.problem).design
    fit = Regression(design, blocks, solution.factor)
    covariance = fit.covariance
    out = {}
    for i, (term, at) in enumerate(zip(solution.terms, slopes, strict=True)):
        own = list(range(fit.slices[i].start, fit.slices[i].stop))
        shaped = [] if at is None else list(range(fit.slices[at].start, fit.slices[at].stop))
        both = np.ix_(own + shaped, own + shaped)
        out[term.place] = _estimate(solution, term, covariance[both], [] if at is None else _refined(term))
    return out


def _estimate(solution: Solution, term: Term, covariance: Float, refined: Sequence[int]) -> Estimate:
    count = solution.block(term)[0].size
    full = np.zeros((count + len(term.shape), count + len(term.shape)))
    places = [*range(count), *(count + i for i in refined)]
    full[np.ix_(places, places)] = covariance
    return Estimate(solution.coefficients(term), np.array(term.shape), full)


def _refined(term: Term) -> list[int]:
    return [i for i, (low, high) in enumerate(term.effect.bounds(term.shape)) if high > low]


def _slopes(problem: Problem, term: Term, coefficients: Float) -> Float | None:
    """Derivative of a term's contribution by each refined shape parameter, (N, k) or (N, C, k); None if there are
    none."""
    out = []
    for i in _refined(term):
        step = 1e-3 * max(abs(term.shape[i]), 1e-3)
        more, less = (
            problem.block(replace(term, shape=(*term.shape[:i], term.shape[i] + way, *term.shape[i + 1 :])))
            for way in (step, -step)
        )
        out.append((more.columns @ coefficients - less.columns @ coefficients) / (2 * step))
    return np.stack(out, axis=-1) if out else None
