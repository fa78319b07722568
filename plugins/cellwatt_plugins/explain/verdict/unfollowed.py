"""Findings that the model follows with no law: something unknown, a link's rebounds, a joint that rattles.

A link that has crossed the gap of its gear hits the flank and rebounds; no model predicts each blow. The times of the
blows are known: just after the load has reversed, and at no other time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.leave_out import LeaveOut
from cellwatt_plugins.explain.fit.noise import hum
from cellwatt_plugins.explain.fit.rows import Filtered
from cellwatt_plugins.explain.fit.sides import encoder_floor, rattling
from cellwatt_plugins.explain.fit.solution import Solution
from cellwatt_plugins.explain.verdict.findings import Alternative, Finding, Improvement, Where
from cellwatt_plugins.explain.verdict.lack_of_fit import LackOfFit, between
from cellwatt_plugins.robot.effects.effect import Parameter
from cellwatt_plugins.robot.motion import FAST

AT_ONCE = 1.0
"""s: a residual that starts earlier than this is present from the beginning, and its first time is not reported."""
DIE_OUT = 0.15
"""s after a reversal of the load within which rebounds die out."""
AGAIN = 5
"""Smallest number of load reversals."""
BLOWS = 5.0
"""Smallest mean square residual after reversals, in units of the noise, that counts as blows."""
ELSEWHERE = 0.1
"""Largest residual beyond the noise at all other times, as a share of that after reversals."""
SELDOM = 0.3
"""Largest share of the time that may lie after reversals; with more, the times do not distinguish rebounds."""
RATTLES = 0.05
"""Share of the time above which a rattling joint is reported."""


def unknown_findings(solution: Solution, lacks: Sequence[LackOfFit]) -> list[Finding]:
    """Findings of channels with a real residual that no known effect explains."""
    supply = solution.problem.side == "supply"
    error, after = (s.problem.rms(LeaveOut(s.problem, s.factor).residual(s.terms)) for s in (solution, solution.best))
    return [_unknown(solution, u, error, after, None if supply else u.channel) for u in lacks]


def _unknown(solution: Solution, found: LackOfFit, error: Float, after: Float, joint: int | None) -> Finding:
    name, unit = solution.problem.channel(found.channel)
    place = "The supply" if joint is None else f"Joint {joint + 1}"
    where = between(found, unit)
    if not where and found.times and found.times[0].start > AT_ONCE:
        where = f", first at {found.times[0].start:.1f} s of {found.times[0].recording}"
    parts = [part[:, found.channel : found.channel + 1] for part in solution.problem.split(solution.residual)]
    tone = hum(parts, [rows.step for rows in solution.problem.rows])
    if tone is not None:
        where += f"; it hums at {tone:.1f} Hz"
    size = f"{found.rms:.3g} {unit.replace('*', '')}"
    share = None if joint is None else rebounds(solution, joint)
    statement = (
        f"{place} shows {size} that no known effect explains{where}."
        if share is None
        else f"{place} shows {size} that no law predicts, all of it just after its load reversed, in "
        f"{100 * share:.0f} % of the time: the link rebounds in the play between motor and link. Backlash is missing; "
        "its width cannot be estimated."
    )
    return Finding(
        effect="unknown" if share is None else "backlash",
        joint=None if joint is None else joint + 1,
        kind="missing",
        confidence=0.9,
        statement=statement,
        parameters={"rms": Parameter(found.rms, 0.0, unit)},
        where=Where((name,), found.position, found.velocity, found.times),
        improvement=Improvement.at(solution.problem, found.channel, error, after),
        followed=False,
    )


def rattling_findings(solution: Solution) -> list[Finding]:
    """Findings of joints that rattle faster than the band in which a servo's law and the motion are compared.

    Drives that act late make joints swing, too: with a time delay, no joint is reported.
    """
    problem = solution.problem
    late = any(term.effect.name == "time_delay" for term in solution.terms)
    if late or problem.states[0].drive is None:
        return []
    shares = np.zeros(len(problem.floor))
    least = np.hypot(problem.size, encoder_floor(problem.states, fast=True))
    for states, rows in zip(problem.states, problem.rows, strict=True):
        if isinstance(rows, Filtered):
            lost = rattling(states.servos.torque - states.nominal, rows, least)
            told = rattling(states.servos.servo.pull * states.servos.command, rows, least)
            shares += np.mean((lost > 0) & (told == 0), axis=0) / len(problem.states)
    found = {term.joint for term in solution.terms if term.effect.name == "backlash"}
    error = problem.rms(solution.residual)
    return [
        Finding(
            effect="backlash",
            joint=joint + 1,
            kind="missing",
            confidence=0.7,
            statement=f"Joint {joint + 1} rattles in {100 * shares[joint]:.0f} % of the time without a command "
            "for it: play between drive and link does this. Its motion during that time was not judged.",
            parameters={},
            where=Where((problem.channel(joint)[0],)),
            improvement=Improvement.at(problem, joint, error, error),
            alternatives=(Alternative("time_delay", None, "a drive that acts late does this, too: lower its gain"),),
            followed=False,
        )
        for joint in np.flatnonzero(shares > RATTLES).tolist()
        if joint not in found
    ]


def rebounds(solution: Solution, joint: int) -> float | None:
    """Share of the time just after a joint's load reversed, if the whole residual lies there; None otherwise.

    Friction, which reverses with the velocity, is excluded: its times are among the others.
    """
    problem = solution.problem
    if min(1 / rows.step for rows in problem.rows) < FAST:
        return None
    squared = np.square(solution.residual[:, joint] * problem.design.root[:, joint])
    reversed_load, turns = [], 0
    for states, rows in zip(problem.states, problem.rows, strict=True):
        load = np.sign(rows.of(states.load)[:, joint])
        turned = np.flatnonzero(load[1:] != load[:-1]) + 1
        after = np.zeros(len(load), np.bool_)
        for row in turned.tolist():
            after[row : row + round(DIE_OUT / rows.step) + 1] = True
        reversed_load.append(after)
        turns += len(turned)
    after = np.concatenate(reversed_load)
    share = float(np.mean(after))
    if turns < AGAIN or not 0 < share < SELDOM:
        return None
    blows, others = float(np.mean(squared[after])), float(np.mean(squared[~after]))
    return share if blows > BLOWS and others - 1 < ELSEWHERE * (blows - 1) else None
