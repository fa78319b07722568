"""A whole campaign: computes the consumer groups and their uncertainty from power at rest and recorded runs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from cellwatt.errors import RecordingError
from cellwatt.files import Place
from cellwatt.progress import stage
from cellwatt.scheduler import spread
from cellwatt.units import Units
from cellwatt_plugins.energy.clock import Offset, align
from cellwatt_plugins.energy.drive import Drive, features
from cellwatt_plugins.energy.equations import brake_power, mean_power_shares, payload_efficiency
from cellwatt_plugins.energy.findings import Findings, Fixed, JointDrive, JointFriction, RunEnergy
from cellwatt_plugins.energy.fixed import AtRest
from cellwatt_plugins.energy.identify import Belief, Identified, Observed, begin, identify
from cellwatt_plugins.energy.recordings import Recorded
from cellwatt_plugins.energy.repetitions import find_repetitions
from cellwatt_plugins.energy.rigid import OFFSET, RigidFit, fit_rigid
from cellwatt_plugins.energy.run_energy import Learnt, edges, run_energy, shared, total_energy
from cellwatt_plugins.robot import Arm


def observed(run: Recorded, known: tuple[Arm, Drive]) -> Observed:
    """Find the repetitions of a run, and the offset of its clocks from a first guess of the arm's drive.

    Raises ``RecordingError`` if no repetition is complete and measured, or power does not follow the motion.
    """
    arm, guess = known
    found, notes = find_repetitions(run.motion)
    feature = features(arm, run.motion.torque, run.motion.velocity)
    one = Observed(run, feature, Offset(0.0, 0.0), tuple(found), tuple(notes))
    kinds = feature.reshape(len(feature), -1, arm.joints).sum(axis=2)  # each kind of power, of all joints
    one = replace(one, offset=align(run.reading, one.modelled(guess), one.integral(kinds)))
    measured = shared(one).sum(axis=1) >= MEASURED * np.array([repetition.seconds for repetition in found])
    if not measured.any():
        raise RecordingError(f"{run.reading.place}: it has too few values in every repetition: record this run again")
    notes += [
        f"the repetition at t = {repetition.start:.1f} s: too few values of the analyzer: not used"
        for repetition, seen in zip(found, measured, strict=True)
        if not seen
    ]
    found = [repetition for repetition, seen in zip(found, measured, strict=True) if seen]
    return replace(one, repetitions=tuple(found), notes=tuple(notes))


MEASURED = 0.7
"""Smallest share of a repetition's time with values of the analyzer; uneven values fall short of 1, too."""
HOLD = (0.3, 0.6)
"""Power of the motors that hold the arm at its pose of least gravity, W: expected value and one standard deviation."""
UNPLUGGED = 0.05
"""Change of the power at rest of an arm without brakes from its measurement to the runs, W, one standard deviation."""
FROM_CURRENT = 0.15
FROM_SENSOR = 0.002
"""Error of a joint's torque as a factor, one standard deviation, for torque from current and from a sensor."""
FROM_RIGID = 0.03
"""Smallest uncertainty of torque factors from the rigid body, since no URDF is complete."""
DRAWS = 60
"""Random draws of the parameters for the uncertainty of derived results."""
OFF = 0.02
"""Smallest difference from 1 of a torque factor that is reported."""


@dataclass(frozen=True)
class Outcome:
    """Findings, and the fit that the report's plots need."""

    findings: Findings
    identified: Identified
    inputs: tuple[Path, ...] = ()
    """The input files; the report names them with their digests."""

    def as_json(self) -> dict[str, Any]:
        """The content of ``energy.json``, as printed by ``cellwatt disaggregate --json``."""
        return self.findings.as_json()

    def report(self, path: Place, units: Units | None = None) -> None:
        """Write the HTML report, ``report.html``, with energies and powers in ``units`` (default: SI).

        Raises ``CellwattError`` if the file cannot be written."""
        from cellwatt.report import Provenance
        from cellwatt_plugins.energy.report import report

        report(self.findings, self.identified, Provenance.here(self.inputs), units or Units()).write(Path(path))


def disaggregate(arm: Arm, rest: AtRest, runs: Sequence[Recorded]) -> Outcome:
    """Run the pipeline of ECDP on one arm. Raises ``RecordingError`` if a run cannot be used."""
    guess = begin(arm, _fixed_power(arm, rest)[0])
    prepared = spread(observed, runs, "repetitions and clocks of runs", shared=(arm, guess))
    with stage("fitting the arm"):
        belief, rigid = _belief(arm, rest, runs)
    with stage("fitting the drives"):
        identified = identify(prepared, guess, belief)
    fixed = _fixed(arm, rest, identified)
    learnt = Learnt(arm, fixed, identified.drive, identified.drawn(np.random.default_rng(3), DRAWS))
    energies = tuple(spread(run_energy, identified.observed, "energy of runs", shared=learnt))
    findings = Findings(
        robot=arm.description.robot,
        fixed=fixed,
        runs=energies,
        payload_efficiency_percent=_payload_efficiency(energies),
        average_share_percent=_average_shares(energies),
        drives=_drives(arm, identified),
        friction=_friction(arm, rigid),
        returned=identified.drive.returned,
        returned_uncertainty=float(np.sqrt(identified.covariance[-1, -1])),
        model_error_percent=_model_error(identified),
        notes=_notes(arm, identified),
        covariance=_covariance(identified),
    )
    return Outcome(findings, identified)


def _fixed_power(arm: Arm, rest: AtRest) -> tuple[float, float]:
    """Power without motion during the runs, W, and its standard deviation, from the measurements at rest."""
    if arm.description.brakes:
        return rest.released.power - HOLD[0], float(np.hypot(HOLD[1], rest.released.uncertainty))
    return rest.connected.power, float(np.hypot(UNPLUGGED, rest.connected.uncertainty))


def _belief(arm: Arm, rest: AtRest, runs: Sequence[Recorded]) -> tuple[Belief, RigidFit]:
    """Prior of fixed power and torque from the measurements at rest and the description."""
    ones = np.ones(arm.joints)
    rigid = fit_rigid(arm, runs, FROM_CURRENT * ones)
    torque, unsure = ones, FROM_SENSOR * ones
    if arm.description.torque_from == "current":
        torque = rigid.torque
        unsure = np.minimum(np.hypot(rigid.uncertainty, FROM_RIGID), FROM_CURRENT)
    return Belief(_fixed_power(arm, rest), torque, unsure, rest.connected.noise), rigid


def _fixed(arm: Arm, rest: AtRest, identified: Identified) -> Fixed:
    """Table II (eqs 14, 16); the runs separate the brakes from the power that holds the arm in the third state."""
    controller, connected, released = rest.controller, rest.connected, rest.released
    electronics = max(connected.power - controller.power, 0.0)
    in_runs, unsure = identified.drive.fixed, fixed_uncertainty(identified)
    hold = max(released.power - in_runs, 0.0) if arm.description.brakes else released.power - connected.power
    brakes = brake_power(released.power, controller.power, electronics, hold) if arm.description.brakes else 0.0
    notes = rest.notes()
    if not arm.description.controller_separate:
        notes.append("controller and arm cannot be unplugged from each other: only the sum of both is measured")
    if brakes < 0:
        notes.append(f"brakes: {brakes:.2f} W measured, which is impossible: reported as 0")
    return Fixed(
        controller=controller.power,
        robot_electronics=electronics,
        brakes=max(brakes, 0.0),
        controller_uncertainty=controller.uncertainty,
        robot_electronics_uncertainty=float(np.hypot(controller.uncertainty, connected.uncertainty)),
        brakes_uncertainty=float(np.hypot(unsure, connected.uncertainty)) if arm.description.brakes else 0.0,
        hold=hold,
        notes=tuple(notes),
    )


def fixed_uncertainty(identified: Identified) -> float:
    """Uncertainty of the fixed power, W: that of the fit, or its drift from run to run if larger."""
    means = [float(one.residual(identified.drive).mean()) for one in identified.observed]
    wandering = float(np.std(means) / np.sqrt(len(means)))
    return max(float(np.sqrt(identified.covariance[0, 0])), wandering)


def _covariance(identified: Identified) -> tuple[tuple[float, ...], ...]:
    """Covariance of the fit, with the variance of the fixed power increased if the power drifted."""
    covariance = identified.covariance.copy()
    covariance[0, 0] = fixed_uncertainty(identified) ** 2
    return tuple(tuple(row) for row in covariance.tolist())


def _average_shares(runs: Sequence[RunEnergy]) -> dict[str, float]:
    """Share of each group in the mean power of all runs, percent (Fig. 8)."""
    groups = ("electronics", "brakes", "mechanical_losses", "electrical_losses_with_regeneration")
    energies = np.array([[getattr(run, group) for group in groups] for run in runs])
    shares = mean_power_shares(energies, np.array([run.seconds for run in runs]))
    return dict(zip(groups, shares.tolist(), strict=True))


def _model_error(identified: Identified) -> float:
    """Measured minus modelled energy, percent, rms over the runs."""
    errors = []
    for one in identified.observed:
        measured = total_energy(one, identified.drive)
        modelled = one.modelled(identified.drive).between(*edges(one))
        errors.append(100 * float((measured - modelled).mean() / measured.mean()))
    return float(np.sqrt(np.mean(np.square(errors))))


def _payload_efficiency(runs: Sequence[RunEnergy]) -> dict[str, float]:
    """ε_P by speed, for the heaviest payload against no payload (eq. 21)."""
    empty = {run.speed_mm_s: run for run in runs if run.payload_kg == 0}
    loaded = [run for run in runs if run.payload_kg > 0 and run.speed_mm_s in empty]
    heaviest = max((run.payload_kg for run in loaded), default=0.0)
    return {
        f"{run.speed_mm_s:g}": payload_efficiency(run.total, empty[run.speed_mm_s].total)
        for run in loaded
        if run.payload_kg == heaviest
    }


def _drives(arm: Arm, identified: Identified) -> tuple[JointDrive, ...]:
    drive, n = identified.drive, arm.joints
    spread = np.sqrt(np.diag(identified.covariance))[1 : 1 + n]
    described = arm.column("winding_resistance")
    return tuple(
        JointDrive(
            joint=joint.name,
            torque_gain=float(1 / drive.torque[i]),
            torque_gain_uncertainty=float(spread[i] / drive.torque[i] ** 2),
            winding_resistance=float(drive.copper[i] * described[i] / drive.torque[i] ** 2),
            switching=float(drive.switching[i] / drive.torque[i]),
            iron=float(drive.eddy[i]),
            hysteresis=float(drive.hysteresis[i]),
        )
        for i, joint in enumerate(arm.description.joints)
    )


def _friction(arm: Arm, rigid: RigidFit) -> tuple[JointFriction, ...]:
    out = []
    for i, joint in enumerate(arm.description.joints):
        found = {law: float(each[i]) for law, each in rigid.friction.items()}
        viscous, coulomb = found.pop("viscous_friction"), found.pop("coulomb_friction")
        offset, windage = found.pop(OFFSET), found.pop("nonlinear_viscous_friction")
        out.append(JointFriction(joint.name, viscous, coulomb, offset, windage, found))
    return tuple(out)


def _notes(arm: Arm, identified: Identified) -> tuple[str, ...]:
    drive, n = identified.drive, arm.joints
    spread = np.sqrt(np.diag(identified.covariance))[1 : 1 + n]
    notes = []
    for joint, factor, unsure in zip(arm.description.joints, drive.torque, spread, strict=True):
        if abs(factor - 1) > max(OFF, 3 * unsure):
            notes.append(f"{joint.name}: the reported torque is the true torque times {1 / factor:.3f}: corrected")
    if negative := [one.run.name for one in identified.observed if one.feature[:, :n].sum() < 0]:
        notes.append(
            f"with the reported torque, mechanical losses would be negative in {', '.join(negative)}: corrected"
        )
    return tuple(notes)
