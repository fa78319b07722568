"""Parameters of the simulation that moved beyond their tolerance, or far enough to explain most of a channel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.nuisance import NUMBERS, Nominal
from cellwatt_plugins.explain.fit.solution import Solution
from cellwatt_plugins.explain.verdict.cascade import Falling
from cellwatt_plugins.explain.verdict.findings import RetunedNumber
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.effects.effect import INHERITED
from cellwatt_plugins.robot.priors import link_prior

MOST = 0.5
"""Share of a channel's mean square error beyond the noise that retuning must remove to explain the channel."""
OWN = 0.25
"""Share of the error removed by retuning that must return without a parameter for the parameter to be named."""
SEEN = 2.0
"""Error, in units of the noise, above which a channel differs from the simulation."""
BEYOND = 2.0
"""Tolerances, and standard errors, beyond which a parameter is out of tolerance."""
CERTAIN = 2.0
"""Standard errors beyond which a parameter is certainly off."""


def retuned_of(solution: Solution, fall: Falling) -> list[RetunedNumber]:
    """The retuned parameters of one side that are worth reporting."""
    best, out = solution.best, list[RetunedNumber]()
    answers, covariance = _answers(fall), best.fit.covariance
    for i, (number, place) in enumerate(zip(best.problem.nuisance, best.problem.design.slices, strict=True)):
        moved = _moved(best.problem.states[0].arm, number, best.fit.coefficients[place], covariance[place, place])
        if not moved:
            continue
        explained = [c for c, gone in answers.items() if _share(best, i, c) > OWN * gone]
        most = max(moved, key=lambda m: abs(m.off) / max(m.tolerance, m.std, 1e-12))
        named = [m for m in moved if m.beyond or (explained and (m is most or abs(m.off) > CERTAIN * m.std))]
        out += [replace(m, statement=_statement(m, fall, explained)) for m in named]
    return out


def _answers(fall: Falling) -> dict[int, float]:
    """Channels (0-based) that retuning mostly explains, with the mean square error that it removes."""
    floor = fall.problem.floor
    beyond = np.square(fall.simulation) - np.square(floor)
    gone = np.square(fall.untuned) - np.square(fall.model)
    return {
        c: float(gone[c])
        for c in fall.problem.observed
        if fall.simulation[c] > SEEN * floor[c] and gone[c] > MOST * beyond[c]
    }


def _share(best: Solution, block: int, channel: int) -> float:
    """Mean square error of a channel that returns without the contribution of a block of nominal parameters."""
    design = best.problem.design
    own, place = design.blocks[block], design.slices[block]
    added = own.times(best.fit.coefficients[place], len(best.problem.floor))[:, channel]
    residual = best.residual[:, channel]
    return float(np.mean(np.square(residual + added)) - np.mean(np.square(residual)))


def _moved(arm: Arm, number: Nominal, off: Float, spread: Float) -> Sequence[RetunedNumber]:
    """Parameters of a link, or one of a joint or the supply, fitted with covariance ``spread``; empty if they have no
    name."""
    robot, name, joint = arm.description, number.name, number.joint
    if name == "link" and joint is not None:
        own = arm.body.parameters().reshape(-1, PER_LINK)[joint]
        return _link(joint, own, off, spread, robot.tolerances.link)
    if name not in NUMBERS:
        return []
    unit, tolerance = NUMBERS[name]
    was = float(getattr(robot if joint is None else robot.joints[joint], name))
    # A resistance is fitted by its relative correction.
    scale = was if name == "winding_resistance" else 1.0
    std, share = float(np.sqrt(spread[0, 0])), getattr(robot.tolerances, tolerance)
    unit = unit if joint is None else robot.unit(joint, unit)
    return [_retuned(name, joint, was, scale * float(off[0]), scale * std, unit, share * was)]


def _link(joint: int, own: Float, off: Float, spread: Float, tolerance: float) -> list[RetunedNumber]:
    """Mass and centre of mass of a link; its moments of inertia if only they moved."""
    prior = np.sqrt(np.diag(link_prior(own, tolerance).covariance))
    mass, now = max(float(own[0]), 1e-6), max(float(own[0] + off[0]), 1e-6)
    out = [_retuned("mass", joint, float(own[0]), float(off[0]), float(np.sqrt(spread[0, 0])), "kg", float(prior[0]))]
    for i, axis in enumerate("xyz", start=1):
        was, is_ = float(own[i]) / mass, float(own[i] + off[i]) / now
        slope = np.array([-is_ / now, 1 / now])
        std = float(np.sqrt(max(0.0, slope @ spread[np.ix_([0, i], [0, i])] @ slope)))
        out.append(_retuned(f"com_{axis}", joint, was, is_ - was, std, "m", tolerance * abs(was) + 0.001))
    sizes = [(name, i, float(own[i])) for name, i in (("ixx", 4), ("iyy", 6), ("izz", 9)) if own[i] > 0]
    if not any(abs(m.off) > m.std for m in out):
        out += [
            _retuned(name, joint, was, float(off[i]), float(np.sqrt(spread[i, i])), "kg*m^2", float(prior[i]))
            for name, i, was in sizes
        ]
    return out


def _retuned(
    parameter: str, joint: int | None, was: float, off: float, fitted_std: float, unit: str, tolerance: float
) -> RetunedNumber:
    """A parameter of a joint (0-based) with its fitted correction ``off``, yet without a statement.

    Its standard deviation includes the uncertainty inherited from the rest of the description.
    """
    std = float(np.hypot(fitted_std, INHERITED * (was + off)))
    number = None if joint is None else joint + 1
    beyond = abs(off) > BEYOND * max(tolerance, std)
    return RetunedNumber(parameter, number, was, was + off, std, unit, tolerance, beyond, "")


def _statement(moved: RetunedNumber, fall: Falling, explained: Sequence[int]) -> str:
    """One or two plain sentences; ``explained`` are the channels (0-based) that the parameter helps to explain."""
    unit = moved.unit.replace("N*m", "Nm").replace("*", " ").replace("^2", "²")
    more, less = ("heavier", "lighter") if moved.parameter == "mass" else ("more", "less")
    way = more if moved.off > 0 else less
    allowed = f"{moved.tolerance:.2g} {unit} (one standard deviation)"
    statement = (
        f"{_what(moved)} is {abs(moved.off):.2g} ± {moved.std:.1g} {unit} {way} than in your simulation: "
        f"{moved.now:.3g} instead of {moved.was:.3g} {unit}. "
        + (f"This is more than twice your tolerance of {allowed}." if moved.beyond else f"Your tolerance is {allowed}.")
    )
    falls = [
        f"{'the supply' if fall.problem.side == 'supply' else f'joint {c + 1}'} ({fall.untuned[c]:.3g} → "
        f"{fall.model[c]:.3g} {fall.problem.channel(c)[1].replace('*', '')})"
        for c in explained
    ]
    return statement + (f" Retuning it with the others explains most of {' and '.join(falls)}." if falls else "")


def _what(moved: RetunedNumber) -> str:
    name = moved.parameter.replace("_", " ").replace("coulomb", "Coulomb")
    if moved.joint is None:
        return "Standby power"
    if moved.parameter == "mass":
        return f"Link {moved.joint}"
    if moved.parameter.startswith("com_"):
        return f"The centre of mass of link {moved.joint} along {moved.parameter[-1]}"
    return f"The {name} of {'link' if moved.parameter.startswith('i') else 'joint'} {moved.joint}"
