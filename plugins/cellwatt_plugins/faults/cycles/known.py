"""Knowledge of a cell that runs healthily: its arm and its cycles, learned or read from the reference file."""

from __future__ import annotations

from dataclasses import dataclass, replace
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
from cellwatt_plugins.faults.cycles.stored import StoredJoint, StoredModel
from cellwatt_plugins.faults.reference import Reference
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.meter import Meter


@dataclass(frozen=True)
class Known:
    """The arm with parameters as its power has them, and a pattern for each task and speed.

    ``false_alarms`` is the share of healthy intervals in which one is accepted.
    """

    arm: FittedArm
    patterns: tuple[Pattern, ...]
    false_alarms: float = 1e-4
    meter: Meter | None = None
    """The slow meter that power is from."""


def learn_known(recording: Recording, arm: Arm) -> Known:
    """Learn from healthy running. Raises ``ModelError`` where the arm is another or nothing recurs."""
    if recording.joints != arm.joints:
        raise ModelError(f"the recording has {recording.joints} joints, robot {arm.name} has {arm.joints}")
    recording = with_meter(recording, arm)
    with stage("finding the cycles"):
        patterns = learn_patterns(recording)
    with stage("fitting the arm"):
        return Known(identify(arm, patterns), tuple(patterns), meter=recording.meter)


def stored(known: Known, arm: Arm) -> tuple[StoredModel, tuple[Pattern, ...]]:
    """Return the content of the file."""
    p = known.arm.parameters
    links = p.link.reshape(-1, 10)
    joints = tuple(
        StoredJoint(name, float(rotor), float(coulomb), float(viscous), float(copper), tuple(link.tolist()))
        for name, rotor, coulomb, viscous, copper, link in zip(
            arm.body.names, p.rotor, p.coulomb, p.viscous, p.copper, links, strict=True
        )
    )
    return StoredModel(p.standby, p.drive, p.regenerate, joints, known.meter), tuple(map(_rounded, known.patterns))


def restored(model: StoredModel, cycles: tuple[Pattern, ...], arm: Arm) -> Known:
    """The inverse of ``stored``. Raises ``ModelError`` where the file is of another arm."""
    names = [joint.name for joint in model.joints]
    if names != list(arm.body.names):
        raise ModelError(f"the reference is of an arm with joints {', '.join(names)}; robot {arm.name} has others")
    joints = model.joints
    parameters = Parameters(
        link=np.concatenate([joint.link for joint in joints]),
        rotor=np.array([joint.rotor_inertia for joint in joints]),
        coulomb=np.array([joint.coulomb_friction for joint in joints]),
        viscous=np.array([joint.viscous_friction for joint in joints]),
        copper=np.array([joint.copper_loss for joint in joints]),
        standby=model.standby,
        drive=model.drive,
        regenerate=model.regenerate,
    )
    window = 0.0 if model.meter is None else model.meter.window
    patterns = tuple(replace(cycle, window=window) for cycle in cycles)
    return Known(with_covariance(arm, parameters, patterns), patterns, meter=model.meter)


def known_of(reference: Reference, path: Path, robot: Path, false_alarms: float) -> Known:
    """Return the knowledge that a reference (of the file ``path``) has of a described robot.

    ``false_alarms``: share of healthy intervals in which one is accepted. Raises ``ModelError`` where the reference has
    no cycles or is of another arm.
    """
    if reference.power_model is None or not reference.cycles:
        raise ModelError(f"reference {path}: has no cycles; learn it again with --robot {robot}")
    known = restored(reference.power_model, reference.cycles, Arm.load(robot))
    return replace(known, false_alarms=false_alarms)


def _rounded(pattern: Pattern) -> Pattern:
    return replace(
        pattern,
        moves=tuple((round(a, 4), round(b, 4)) for a, b in pattern.moves),
        position=np.round(pattern.position, 6),
        power=np.round(pattern.power, 2),
        spread=np.round(pattern.spread, 2),
    )
