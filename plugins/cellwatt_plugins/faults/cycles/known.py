"""Knowledge of a healthy cell, its arm and its cycles: learned, or read from the reference file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import ModelError
from cellwatt.progress import stage
from cellwatt_plugins.faults.cycles.arm import Parameters
from cellwatt_plugins.faults.cycles.bare_arm import BareArm
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


def learn_known(recording: Recording, arm: Arm | BareArm) -> Known:
    """Learn from a healthy recording. Raises ``ModelError`` if it is of another arm or no task recurs."""
    if isinstance(arm, Arm) and recording.joints != arm.joints:
        raise ModelError(f"the recording has {recording.joints} joints, robot {arm.name} has {arm.joints}")
    recording = with_meter(recording, arm).in_angles(arm.body.levers)
    with stage("finding the cycles"):
        patterns = learn_patterns(recording)
    with stage("fitting the arm"):
        return Known(identify(arm, patterns, recording.meter), tuple(patterns), meter=recording.meter)


def stored(known: Known, arm: Arm | BareArm) -> tuple[StoredModel, tuple[Pattern, ...]]:
    """Return the model and the cycles for the reference file; the joints of a bare arm are fitted again when read."""
    p = known.arm.parameters
    each = (p.rotor, p.coulomb, p.viscous, p.copper)
    names = () if isinstance(arm, BareArm) else arm.body.names
    rows = zip(names, *(values.tolist() for values in each), p.link.reshape(-1, 10).tolist(), strict=bool(names))
    joints = tuple(StoredJoint(name, r, c, v, loss, tuple(link)) for name, r, c, v, loss, link in rows)
    cycles = tuple(pattern.scaled(arm.body.levers) for pattern in known.patterns)
    return StoredModel(p.standby, p.drive, p.regenerate, joints, known.meter), cycles


def restored(model: StoredModel, cycles: tuple[Pattern, ...], arm: Arm | BareArm, false_alarms: float = 1e-4) -> Known:
    """The inverse of ``stored``; ``false_alarms`` as in ``Known``. Raises ``ModelError`` if it is of another arm."""
    patterns = tuple(cycle.scaled(1 / arm.body.levers) for cycle in cycles)
    if isinstance(arm, BareArm):
        return Known(identify(arm, patterns, model.meter), patterns, false_alarms, model.meter)
    joints = model.joints
    if [joint.name for joint in joints] != list(arm.body.names):
        names = ", ".join(joint.name for joint in joints)
        raise ModelError(f"the reference is of an arm with joints {names}; robot {arm.name} has others")
    link = np.concatenate([joint.link for joint in joints])
    keys = ("rotor_inertia", "coulomb_friction", "viscous_friction", "copper_loss")
    rotor, coulomb, viscous, copper = (np.array([getattr(joint, key) for joint in joints]) for key in keys)
    parameters = Parameters(link, rotor, coulomb, viscous, copper, model.standby, model.drive, model.regenerate)
    return Known(with_covariance(arm, parameters, patterns, model.meter), patterns, false_alarms, model.meter)


def known_of(
    reference: Reference, path: Path, robot: Path | None, levers: Float | None = None, false_alarms: float = 1e-4
) -> Known:
    """Return the knowledge of a robot from ``reference``, read from the file ``path``.

    ``robot`` is its description, None if there is none; ``levers`` (n,) are then those of its joints (default: all 1).
    ``false_alarms`` is the accepted share of healthy intervals with a false alarm. Raises ``ModelError`` if the
    reference has no cycles or belongs to another arm.
    """
    arm = BareArm(np.ones(reference.joints) if levers is None else levers) if robot is None else Arm.load(robot)
    if isinstance(arm, Arm) and reference.robot not in (None, arm.name):
        raise ModelError(f"reference {path}: is of robot {reference.robot}, {robot} describes {arm.name}")
    described = robot is None or bool(reference.names)
    if reference.power_model is None or not reference.cycles or not described:
        more = f"with --robot {robot}" if robot else f"with `cellwatt reference RECORDING... --out {path}`"
        raise ModelError(
            f"reference {path}: has no {'cycles' if described else 'model of the arm'}; learn it again {more}"
        )
    return restored(reference.power_model, reference.cycles, arm, false_alarms)
