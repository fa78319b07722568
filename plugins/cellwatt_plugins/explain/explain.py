"""Explain why recordings differ from the simulation: search of both sides, held-out errors, findings, model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cellwatt.arrays import Float
from cellwatt.files import Place
from cellwatt.progress import stage
from cellwatt.report.numbers import listed
from cellwatt_plugins.explain.fit.leave_out import LeaveOut
from cellwatt_plugins.explain.fit.metering import Metering, Unknown, metering
from cellwatt_plugins.explain.fit.problem import UNKNOWN_VARIANCE, Problem
from cellwatt_plugins.explain.fit.search import search
from cellwatt_plugins.explain.fit.search.solve import fitted
from cellwatt_plugins.explain.fit.search.state import now
from cellwatt_plugins.explain.fit.sides import supply_problem, torque_problem
from cellwatt_plugins.explain.fit.solution import Solution
from cellwatt_plugins.explain.fit.swinging_links import remaining_chi2
from cellwatt_plugins.explain.fit.thresholds import DEFAULT, by_law
from cellwatt_plugins.explain.input.admission import Admitted
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.model import Model
from cellwatt_plugins.explain.simulators import load_simulator
from cellwatt_plugins.explain.verdict.cascade import Falling, cascade, falling
from cellwatt_plugins.explain.verdict.coupled import as_coupled
from cellwatt_plugins.explain.verdict.estimates import model_of
from cellwatt_plugins.explain.verdict.events import merged
from cellwatt_plugins.explain.verdict.findings import ChannelFit, Finding, Findings, FoundCurve, RetunedNumber, Verdict
from cellwatt_plugins.explain.verdict.lack_of_fit import LackOfFit, lack_of_fit, unexplained_channel
from cellwatt_plugins.explain.verdict.mounting import Mounting, as_mounted
from cellwatt_plugins.explain.verdict.naming import curves_of, findings_of
from cellwatt_plugins.explain.verdict.retuned import retuned_of
from cellwatt_plugins.explain.verdict.unfollowed import rattling_findings, unknown_findings
from cellwatt_plugins.robot import RobotDescription
from cellwatt_plugins.robot.effects import EFFECTS
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.servo import IN_MOTION

POORLY = 1.5
"""Mean square residual, in units of the noise, above which the supply's model uses a joint's measured torque."""
CURRENT_GAIN = 0.1
"""Typical relative error of a torque constant from a data sheet."""
EXCESS = 0.35
"""Mean square residual beyond noise, in units of the noise, above which a channel is unexplained."""
WITHOUT_PLAN = 2.0
"""Value of ``EXCESS`` where accelerations come from encoders alone."""
FAR = 2.0
"""Held-out error, in units of the noise, above which a channel is not explained in full."""
SUPPLY_SHARE = 0.2
"""Share of the time limit that is reserved for the supply."""
SETTLED = 1.3
"""Largest mean square residual of the joints, in units of the noise, at which the supply's residual can be judged."""


@dataclass(frozen=True)
class Explained:
    """Findings, the model, and the solutions on which they rest."""

    findings: Findings
    model: Model
    torque: Solution
    supply: Solution | None
    runs: tuple[Run, ...]
    inputs: tuple[Path, ...] = ()
    """The input files; the report names them with their digests."""
    simulator: Path | None = None
    """The simulator's own file, if the recordings are compared with one."""

    def as_json(self) -> dict[str, Any]:
        """The content of ``findings.json``, which ``cellwatt explain --json`` prints."""
        return self.findings.as_json()

    def report(self, path: Place, mended: Path | None = None) -> None:
        """Write the page ``report.html``; ``mended`` is the simulator's file as written by ``mend``.

        Raises ``CellwattError`` if the file cannot be written.
        """
        from cellwatt.report import Provenance
        from cellwatt_plugins.explain.report.page import report
        from cellwatt_plugins.explain.report.trace import traces_of

        made_from = Provenance.here(self.inputs)
        problems = [side.problem for side in (self.torque, self.supply) if side is not None]
        floors = {p.channel(c)[0]: floor for p in problems for c, floor in enumerate(p.floor.tolist())}
        traces = traces_of(self.runs, self.model, self.torque)
        moved = []
        if self.simulator is not None and self.runs[0].drive is not None:
            from cellwatt_plugins.explain.report import motion

            moved = [motion.section(self.runs, load_simulator(self.simulator, self.model.robot.names), mended)]
        report(self.findings, traces, self.model.robot.robot, floors, made_from, moved).write(Path(path))


def explain(runs: Sequence[Run], admitted: Admitted, seconds: float = np.inf) -> Explained:
    """Find where the ``admitted`` runs differ from the simulation, name the causes and model them.

    The search stops after ``seconds``; see ``now``.
    """
    until = now() + seconds
    with stage("checking how the arm is mounted"):
        base, states, mounted = as_mounted(runs, admitted.states, admitted.base)
    with stage("checking which motors turn with which joints"):
        base, states, coupled = as_coupled(runs, states, base)
    powered = any(run.power is not None for run in runs)
    limit = until - SUPPLY_SHARE * seconds if powered else until
    with stage("looking for effects in the torques"):
        effects, thresholds = (EFFECTS, DEFAULT) if states[0].drive is None else (IN_MOTION, by_law(DEFAULT))
        make = partial(torque_problem, runs, states)
        torque = search(make, base.arm.body.joints, thresholds, effects, until=limit, powered=powered)
    driven, doubt = _torque_for_power(runs, torque.best)
    meter = metering(runs, driven)
    supplied = None if isinstance(meter, Unknown) else supply_problem(runs, driven, doubt, meter)
    with stage("looking for effects in the supply"):
        supply = None if supplied is None else search(lambda *_: supplied, 1, until=until)
    with stage("judging on data left out"):
        findings = _findings(runs, torque, supply, (*admitted.notes, *_of_meter(meter)), mounted, coupled)
    return Explained(findings, model_of(torque.best, supply, base), torque, supply, tuple(runs))


def _torque_for_power(runs: Sequence[Run], torque: Solution) -> tuple[list[States], list[Float]]:
    """States with the supply's torque, fitted or (where the fit is poor) measured, and its uncertainty (N, n) Nm."""
    problem = torque.problem
    chi2 = problem.chi2(torque.residual)
    poor = chi2 > POORLY
    unexplained = problem.floor * np.where(poor, 1.0, np.sqrt(np.maximum(chi2 - 1.0, 0.0)))
    variance = problem.every_sample(np.concatenate(problem.variance))
    doubt = []
    for v, states in zip(variance, problem.states, strict=True):
        # A torque that was not measured is as uncertain as it is large, and no more.
        beyond = np.where(v < UNKNOWN_VARIANCE * problem.floor**2, v - problem.floor**2, states.torque**2)
        doubt.append(np.sqrt(unexplained**2 + np.maximum(beyond, 0.0)))
    out = []
    for run, states, after in zip(runs, problem.states, _measurement_errors(torque), strict=True):
        best = states.torque.copy()
        if np.any(poor):
            read = run.torque - after
            best[:, poor] = np.where(np.isfinite(read), read, best)[:, poor]
        out.append(states.with_torque(best))
    return out, doubt


def _measurement_errors(torque: Solution) -> list[Float]:
    """Torque (N, n) Nm that effects on the measurement alone add to each run."""
    problem = torque.problem
    out = [np.zeros_like(s.torque) for s in problem.states]
    for term in torque.terms:
        if term.effect.mechanical:
            continue
        for part, more in zip(out, problem.torques(term, torque.coefficients(term)), strict=True):
            part += more
    return out


def _findings(
    runs: Sequence[Run],
    torque: Solution,
    supply: Solution | None,
    admitted: Sequence[str],
    mounted: Mounting | None,
    coupled: Sequence[Finding],
) -> Findings:
    sides = [torque] if supply is None else [torque, supply]
    structure = (*([] if mounted is None else [mounted.finding]), *coupled)
    found = [_with_noise(each, torque.problem) for each in structure]
    rests, fit, tried = [], [], []
    falls, moved = list[Falling](), list[RetunedNumber]()
    curves: list[FoundCurve] = []
    planned = all(run.plan is not None for run in runs)
    size = torque.problem.states[0].robot.tolerances.unexplained
    limits = EXCESS if planned else WITHOUT_PLAN, size
    for solution in sides:
        best = solution.best
        held = LeaveOut(best.problem, best.factor)
        nominal = solution.problem.chi2(solution.problem.fit([]).residual)
        own = lack_of_fit(nominal, solution, *limits)
        # A residual that retuning within tolerance removes is not unknown, even if data left out do not confirm the
        # retuning.
        if own and solution.free is not None:
            tuned = lack_of_fit(nominal, fitted(solution.free, solution.terms), *limits)
            own = [u for u in own if any(u.channel == other.channel for other in tuned)]
        falls.append(falling(solution))
        found += findings_of(solution, falls[-1], own, _gain_tolerance(runs, torque.problem.states[0].robot))
        if solution is torque or np.max(remaining_chi2(torque)) < SETTLED:
            found += unknown_findings(solution, [u for u in own if _searched(solution, u)])
        rests += [unexplained_channel(u, *solution.problem.channel(u.channel), _searched(solution, u)) for u in own]
        curves += curves_of(best, held)
        moved += retuned_of(solution, falls[-1])
        started = mounted.before if mounted is not None and solution is torque else falls[-1].simulation
        fit += _fit(best, held, started)
        tried += solution.tried
    found += rattling_findings(torque)
    found = found if mounted is None else mounted.with_tilt(found)
    named = any(f.effect != "unknown" for f in found)
    # Intermittent effects cannot be tested on data left out.
    once = any(term.effect.form.intermittent for solution in sides for term in solution.terms)
    far = not once and any(c.model > FAR * c.noise_floor for c in fit)
    verdict = _verdict(named, bool(rests) or (named and far))
    return Findings(
        verdict,
        tuple(merged(found)),
        tuple(rests),
        tuple(fit),
        tuple(tried),
        (*admitted, *_notes(runs, torque, supply)),
        curves=tuple(curves),
        retuned=tuple(moved),
        cascade=cascade(falls, None if mounted is None else mounted.before),
    )


def _searched(solution: Solution, found: LackOfFit) -> bool:
    """True if the candidates of a channel were tried before the time limit."""
    return solution.problem.side == "supply" or found.channel not in solution.unsearched


def _with_noise(found: Finding, problem: Problem) -> Finding:
    floor = float(problem.floor[int(found.improvement.channel.removeprefix("tau_")) - 1])
    return replace(found, improvement=replace(found.improvement, noise_floor=floor))


def _gain_tolerance(runs: Sequence[Run], robot: RobotDescription) -> float:
    """Tolerance of a common factor on all torques, as a share."""
    if robot.tolerances.torque_gain is not None:
        return robot.tolerances.torque_gain
    return CURRENT_GAIN if any(run.torque_from == "current" for run in runs) else 0.0


def _fit(solution: Solution, held: LeaveOut, simulation: Float) -> list[ChannelFit]:
    """Held-out error of each channel: of the simulation (C,), with nominal parameters retuned, and with the model."""
    problem = solution.problem
    refit, model = problem.rms(held.residual([])), problem.rms(held.residual(solution.terms))
    return [
        ChannelFit(*problem.channel(c), float(simulation[c]), float(refit[c]), float(model[c]), float(problem.floor[c]))
        for c in problem.observed
    ]


def _of_meter(meter: Metering | Unknown | None) -> tuple[str, ...]:
    if meter is None:
        return ()
    if isinstance(meter, Unknown):
        return (
            f"Power has one value every {meter.interval:.2g} s, and the motion does not show when it was measured: "
            "the supply was not judged. Record a longer motion, or a faster meter.",
        )
    return (f"Power is from a slow meter ({meter.meter.description}): it was compared with means over the same times.",)


def _verdict(named: bool, rest: bool) -> Verdict:
    if named:
        return "partly_explained" if rest else "explained"
    return "unexplained" if rest else "no_mismatch"


def _notes(runs: Sequence[Run], torque: Solution, supply: Solution | None) -> tuple[str, ...]:
    notes = []
    if torque.spent or (supply is not None and supply.spent):
        joints = [str(joint + 1) for joint in torque.unsearched]
        missed = f"; joint{'s' * (len(joints) > 1)} {listed(joints)} not looked at in full" if joints else ""
        notes.append(f"The time limit was reached before all was tried{missed}: a longer --time may give more findings")
    if any(run.drive is not None for run in runs):
        notes.append(
            "No torque was recorded: it is computed by the law of the simulation's servos. Motion cannot show a common "
            "factor on gains, masses and friction: for that factor, your numbers are assumed right within tolerances."
        )
    longest = max(float(run.time[-1] - run.time[0]) for run in runs)
    if longest < 100:
        notes.append(f"The longest run lasts {longest:.0f} s: effects of warming up could not be tested.")
    return tuple(notes)
