"""Knowledge of a healthy cell, its arm and its cycles: learned, or read from the reference file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cellwatt.errors import ModelError
from cellwatt.progress import stage
from cellwatt_plugins.faults.cycles.arm import Parameters
from cellwatt_plugins.faults.cycles.identify import FittedArm, identify, with_covariance
from cellwatt_plugins.faults.cycles.learn import learn_patterns
from cellwatt_plugins.faults.cycles.metering import with_meter
from cellwatt_plugins.faults.cycles.pattern import Pattern
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.reference import Reference, StoredJoint, StoredModel
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.meter.model import Meter


@dataclass(frozen=True)
class Known:
    """The arm with its fitted parameters, and a pattern for each task and speed.

    ``false_alarms`` is the accepted share of healthy intervals with a false alarm. The positions of ``patterns`` are in
    rad as of ``Recording.in_angles``; the reference file has m for prismatic joints.
    """

    arm: FittedArm
    patterns: tuple[Pattern, ...]
    false_alarms: float = 1e-4
    meter: Meter | None = None
    """The slow meter that measured the power; None if the power was sampled."""


def learn_known(recording: Recording, arm: Arm) -> Known:
    """Learn from a healthy recording. Raises ``ModelError`` if it is of another arm or no task recurs."""
    if recording.joints != arm.joints:
        raise ModelError(f"the recording has {recording.joints} joints, robot {arm.name} has {arm.joints}")
    recording = with_meter(recording, arm).in_angles(arm.body.levers)
    with stage("finding the cycles"):
        patterns = learn_patterns(recording)
    with stage("fitting the arm"):
        return Known(identify(arm, patterns, recording.meter), tuple(patterns), meter=recording.meter)


def stored(known: Known, arm: Arm) -> tuple[StoredModel, tuple[Pattern, ...]]:
    """Return the model and the cycles for the reference file."""
    p = known.arm.parameters
    each = (p.rotor, p.coulomb, p.viscous, p.copper)
    rows = zip(arm.body.names, *(values.tolist() for values in each), p.link.reshape(-1, 10).tolist(), strict=True)
    joints = tuple(StoredJoint(name, r, c, v, loss, tuple(link)) for name, r, c, v, loss, link in rows)
    cycles = tuple(pattern.scaled(arm.body.levers) for pattern in known.patterns)
    return StoredModel(p.standby, p.drive, p.regenerate, joints, known.meter), cycles


def restored(model: StoredModel, cycles: tuple[Pattern, ...], arm: Arm, false_alarms: float = 1e-4) -> Known:
    """The inverse of ``stored``; ``false_alarms`` as in ``Known``. Raises ``ModelError`` if it is of another arm."""
    joints = model.joints
    if [joint.name for joint in joints] != list(arm.body.names):
        names = ", ".join(joint.name for joint in joints)
        raise ModelError(f"the reference is of an arm with joints {names}; robot {arm.name} has others")
    link = np.concatenate([joint.link for joint in joints])
    keys = ("rotor_inertia", "coulomb_friction", "viscous_friction", "copper_loss")
    rotor, coulomb, viscous, copper = (np.array([getattr(joint, key) for joint in joints]) for key in keys)
    parameters = Parameters(link, rotor, coulomb, viscous, copper, model.standby, model.drive, model.regenerate)
    patterns = tuple(cycle.scaled(1 / arm.body.levers) for cycle in cycles)
    return Known(with_covariance(arm, parameters, patterns, model.meter), patterns, false_alarms, model.meter)


def known_of(reference: Reference, path: Path, robot: Path, false_alarms: float = 1e-4) -> Known:
    """Return the knowledge of a described robot from ``reference``, read from the file ``path``.

    ``false_alarms`` is the accepted share of healthy intervals with a false alarm. Raises ``ModelError`` if the
    reference has no cycles or belongs to another arm.
    """
    arm = Arm.load(robot)
    if reference.robot not in (None, arm.name):
        raise ModelError(f"reference {path}: is of robot {reference.robot}, {robot} describes {arm.name}")
    if reference.power_model is None or not reference.cycles:
        raise ModelError(f"reference {path}: has no cycles; learn it again with --robot {robot}")
    return restored(reference.power_model, reference.cycles, arm, false_alarms)
