"""Findings from accepted terms (``fit.acceptance``): statement, confidence, location, improvement, and rival names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.acceptance import active
from cellwatt_plugins.explain.fit.leave_out import LeaveOut, compared, rms
from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.explain.fit.solution import Candidate, Solution
from cellwatt_plugins.explain.verdict.cascade import Added, Falling
from cellwatt_plugins.explain.verdict.estimates import estimates
from cellwatt_plugins.explain.verdict.findings import Alternative, Finding, FoundCurve, Improvement, Span, Where
from cellwatt_plugins.explain.verdict.lack_of_fit import LackOfFit, mostly
from cellwatt_plugins.robot.curves import Curve
from cellwatt_plugins.robot.effects.effect import INHERITED, Estimate, Parameter
from cellwatt_plugins.robot.stretches import stretches

NEARLY = 0.85
"""Share of a name's evidence above which a rival is listed beside it."""
CLOSE = 12.0
"""nats of evidence within which a rival is listed, too."""
SIZEABLE = 0.1
"""Smallest share of the error beyond the noise that a finding removes in its step to be near certain."""
SEEN = 0.05
"""Smallest share of the whole error that it removes for that."""


def findings_of(solution: Solution, steps: Falling, lacks: Sequence[LackOfFit], gain: float = 0.0) -> list[Finding]:
    """The terms of one side as findings, largest first, each with its step of the cascade.

    ``lacks`` are the channels that stay unexplained; ``gain`` is the tolerance of the common factor of all measured
    torques.
    """
    known = estimates(solution)
    beside = LeaveOut(solution.problem, solution.factor)
    last = solution.problem.rms(beside.residual(solution.terms))
    found = [
        (added, _finding(solution, beside, added, known[added.term.place], last, gain))
        for added in steps.added
        if not added.curve
    ]
    named = [finding for added, finding in found if not _open(added.term, finding)]
    return [finding for finding in named if not _mean_of(lacks, finding)]


def _mean_of(lacks: Sequence[LackOfFit], finding: Finding) -> bool:
    """True for an offset smaller than the unexplained residual of its joint: it may be the mean of that residual."""
    rest = max((u.rms for u in lacks if finding.joint == u.channel + 1), default=0.0)
    return finding.effect == "torque_offset" and abs(finding.parameters["offset"].value) < rest


def _open(term: Term, finding: Finding) -> bool:
    """True for a joint's term whose strength is smaller than its standard deviation."""
    strength = next(iter(finding.parameters.values()))
    return term.joint is not None and term.effect.acts_on != "links" and strength.std > abs(strength.value)


def _finding(
    solution: Solution, beside: LeaveOut, added: Added, estimate: Estimate, last: Float, gain: float
) -> Finding:
    term = added.term
    robot = solution.problem.states[0].robot
    parameters = {
        name: _scaled(parameter, 0.0 if name == "phase" else term.effect.uncertainty.inherited.get(name, INHERITED))
        for name, parameter in term.effect.parameters(estimate, robot, term.joint).items()
    }
    for name in term.effect.uncertainty.torque_gain if gain > 0 else ():
        parameters[name] = _scaled(parameters[name], gain)
    if term.joint is not None:
        parameters = {name: replace(p, unit=robot.unit(term.joint, p.unit)) for name, p in parameters.items()}
    described = term.effect.described(robot, term.joint)
    who = "The robot" if term.joint is None else f"Joint {term.number}"
    statement = _mistuned(who, term, parameters, described) if described else term.effect.statement(who, parameters)
    channels = _channels(solution, term)
    gone = (added.before - added.after) / solution.problem.floor
    main = max(channels, key=lambda c: float(gone[c]))
    own, rivals = solution.rivals.get(term.place, (0.0, ()))
    seen = term.effect.form.intermittent
    step = 1.0 if seen else max(0.0, _share(solution, main, added.before, added.after))
    share = step
    if share < SIZEABLE:
        without = solution.problem.rms(beside.residual([t for t in solution.terms if t is not term]))
        share = max(share, _share(solution, main, without, last))
    return Finding(
        effect=term.effect.name,
        joint=term.number,
        # A torque gain is of an imprecise torque constant in the description.
        kind="mistuned" if described or (gain > 0 and term.effect.name == "torque_gain") else "missing",
        confidence=min(_confidence(term, own, rivals), _worth(step, share, seen or _seen(main, added))),
        statement=statement if term.joint is None else robot.unit(term.joint, statement),
        parameters=parameters,
        where=_where(solution, term, channels),
        # Intermittent effects cannot be tested on data left out.
        improvement=replace(Improvement.at(solution.problem, main, added.before, added.after), held_out=not seen),
        alternatives=(*_alternatives(term, own, rivals), *_inseparable(term, gain)),
        was=described or None,
    )


def _mistuned(who: str, term: Term, parameters: Mapping[str, Parameter], described: float) -> str:
    """One plain sentence on a parameter of the description that is off."""
    name, off = term.effect.name.replace("_", " ").replace("coulomb", "Coulomb"), next(iter(parameters.values()))
    unit = off.unit.replace("N*m", "Nm").replace("*", "·")
    return (
        f"{who}'s {name} is {described + off.value:.3g} ± {off.std:.2g} {unit}, not {described:.3g}: "
        "it is mistuned beyond its tolerance."
    )


def _scaled(parameter: Parameter, share: float) -> Parameter:
    """The parameter with a further relative uncertainty ``share``."""
    return Parameter(parameter.value, float(np.hypot(parameter.std, share * parameter.value)), parameter.unit)


def _inseparable(term: Term, gain: float) -> tuple[Alternative, ...]:
    if gain == 0 or not term.effect.uncertainty.torque_gain:
        return ()
    why = (
        "mass and torque gain are not separable in these recordings: 1 % of gain is 1 % of mass, and the gain is "
        f"known to {100 * gain:.0f} %; weigh the load, or record once with a known one and set tolerances.torque_gain"
    )
    return (Alternative("torque_gain", None, why),)


def curves_of(solution: Solution, held: LeaveOut) -> list[FoundCurve]:
    """The curves of a solution, each with the share of the error that it removes."""
    robot, out = solution.problem.states[0].robot, []
    for term in solution.terms:
        curve, joint = term.effect, term.joint or 0
        if not isinstance(curve, Curve):
            continue
        others = [t for t in solution.terms if t is not term]
        share = compared(held.errors(others), held.errors(solution.terms), [joint]).share
        statement = (
            f"{100 * share:.0f} % of the residual of joint {joint + 1} follows {curve.along}, by no known law: the "
            "curve is in the model."
        )
        name, unit = f"tau_{joint + 1}", robot.unit(joint, curve.unit)
        values = tuple(solution.coefficients(term).tolist())
        out.append(FoundCurve(name, curve.along, unit, term.shape, values, share, statement))
    return out


def _channels(solution: Solution, term: Term) -> list[int]:
    """Channels in which a term adds at least half of the noise floor, or the one with the largest contribution."""
    size = rms(solution.added(term)) / solution.problem.floor
    felt = [int(c) for c in np.flatnonzero(size > 0.5)]
    return felt or [int(np.argmax(size))]


def _share(solution: Solution, channel: int, before: Float, after: Float) -> float:
    """Share of a channel's mean square error beyond the noise that is removed."""
    beyond = float(before[channel] ** 2 - solution.problem.floor[channel] ** 2)
    return float(before[channel] ** 2 - after[channel] ** 2) / beyond if beyond > 0 else 0.0


def _where(solution: Solution, term: Term, channels: Sequence[int]) -> Where:
    names = tuple(solution.problem.channel(c)[0] for c in channels)
    if term.joint is None:
        return Where(names, times=_spans(solution, term))
    size = np.abs(np.concatenate(solution.problem.torques(term, solution.coefficients(term)))[:, term.joint])
    strong = size > 0.5 * np.max(size)
    speed = np.concatenate([s.qd[:, term.joint] for s in solution.problem.states])
    place = np.concatenate([s.q[:, term.joint] for s in solution.problem.states])
    return Where(names, mostly(place[strong], place), mostly(speed[strong], speed), _spans(solution, term))


def _spans(solution: Solution, term: Term) -> tuple[Span, ...]:
    """Stretches of the runs during which an intermittent term is active."""
    if not term.effect.form.intermittent:
        return ()
    out = []
    for states, columns in zip(solution.problem.states, solution.problem.columns(term), strict=True):
        spans = stretches(active(columns))
        out += [Span(states.name, float(states.time[a]), float(states.time[b - 1])) for a, b in spans]
    return tuple(out[:40])


def _confidence(term: Term, own: float, rivals: Sequence[Candidate]) -> float:
    """Share of the name's evidence among all names tried in its place.

    More complex names are excluded: they always fit as well, and must do better on data left out.
    """
    gains = np.array([own, *(r.gain for r in rivals if term.effect.name not in r.term.effect.relations.beats)])
    weights = np.exp(np.minimum(gains - own, 0.0))
    return float(np.clip(1 / np.sum(weights), 0.5, 0.99))


def _seen(main: int, added: Added) -> bool:
    """True if a term's step visibly reduces the error of its main channel."""
    return bool(added.after[main] < (1 - SEEN) * added.before[main])


def _worth(step: float, share: float, seen: bool) -> float:
    """Upper limit of the confidence in a finding that removes ``step`` in its step, and ``share`` there or beside all
    others."""
    most = 0.5 + 0.49 * min(1.0, max(0.0, share) / SIZEABLE)
    return most if seen and step >= SIZEABLE else min(most, 0.98)


def _alternatives(term: Term, own: float, rivals: Sequence[Candidate]) -> tuple[Alternative, ...]:
    """Names that fit nearly as well, with the experiment that distinguishes them."""
    experiments: Mapping[str, str] = {c.effect: c.experiment for c in term.effect.confusions}
    out = []
    for rival in rivals:
        name = rival.term.effect.name
        if term.effect.name in rival.term.effect.relations.contains:
            continue
        if rival.gain > NEARLY * own or own - rival.gain < CLOSE:
            why = experiments.get(name, "repeat with slower and faster motion, and with another load")
            close = "fits as well" if own - rival.gain < CLOSE else "fits nearly as well"
            out.append(Alternative(name, rival.term.number, f"{close}; to distinguish them: {why}"))
    return tuple(out[:3])
