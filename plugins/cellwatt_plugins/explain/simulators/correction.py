"""Correction of a simulator: a model's findings in the terms that simulators have, and the remainder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.problem import Term
from cellwatt_plugins.explain.model import FittedTerm, Retuned
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.effects.effect import Effect
from cellwatt_plugins.robot.effects.load.gravity_tilt import turned
from cellwatt_plugins.robot.effects.states import States


@dataclass(frozen=True)
class Correction:
    """Correction to be added to a simulator of n joints."""

    friction: Float
    """(n,) Nm, against the motion."""
    damping: Float
    """(n, 3) Nm for w, w·abs(w) and w³, w in rad/s."""
    armature: Float
    """(n,) kg m²."""
    links: Float
    """(n, 10), inertial parameters in the URDF's joint frames."""
    payload: Float | None
    """(10,) in the last joint's frame."""
    spring: Float
    """(n, 2): stiffness Nm/rad, and the torque Nm at 0 rad."""
    gain: Float
    """(n,): measured torque over true torque, less 1."""
    gravity: Float
    """(3,) m/s² in the base's frame."""
    coupling: Float | None = None
    """Turns (n, n) of each motor per turn of each joint: friction, damping and armature are then the motors'."""


def correction(
    retuned: Retuned, terms: Sequence[FittedTerm], states: Sequence[States], mount: Float | None = None
) -> Correction:
    """Return the correction of the simulation with which a model was compared.

    ``mount`` (3,) m/s²: difference of gravity, if the arm is mounted differently than in the simulation.
    """
    n = len(retuned.coulomb_friction)
    friction, armature = retuned.coulomb_friction.copy(), retuned.rotor_inertia.copy()
    damping = np.column_stack([retuned.viscous_friction, np.zeros((n, 2))])
    links = retuned.inertial.reshape(n, PER_LINK).copy()
    spring, gain, gravity, payload = np.zeros((n, 2)), np.zeros(n), np.zeros(3), None
    if mount is not None:
        gravity += mount
    for fitted in terms:
        joint, own = fitted.term.joint or 0, fitted.coefficients
        match fitted.term.effect.name:
            case "coulomb_friction":
                friction[joint] += own[0]
            case "asymmetric_friction" if fitted.term.shape[0] != 0:
                friction[joint] += 0.5 * own[0]
            case "viscous_friction":
                damping[joint, 0] += own[0]
            case "nonlinear_viscous_friction" if fitted.term.shape[0] > 1:
                damping[joint] += own[0] * _polynomial(fitted.term.shape[0], states, joint)
            case "rotor_inertia":
                armature[joint] += own[0]
            case "link_inertial_error":
                links[joint] += own
            case "payload":
                payload = own.copy()
            case "spring_load":
                spring[joint] += own
            case "torque_offset":
                spring[joint, 1] += own[0]
            case "torque_gain":
                gain[joint] += own[0]
            case "gravity_tilt":
                gravity += own @ turned(states[0].arm.body.gravity_field, fitted.term.shape)
    coupling = states[0].arm.coupling
    return Correction(friction, damping, armature, links, payload, spring, gain, gravity, coupling)


def holds(term: Term) -> bool:
    """True if a simulator's file can hold an effect, or most of it."""
    name, shape = term.effect.name, term.shape
    if name == "asymmetric_friction":
        return shape[0] != 0
    return expressed(term.effect) or (name == "nonlinear_viscous_friction" and shape[0] > 1)


def expressed(effect: Effect) -> bool:
    """True if a simulator's file holds all of an effect."""
    return effect.name in (OF_DRIVE if effect.acts_on == "drive" else EXPRESSED)


def of_coupled(term: Term, arm: Arm) -> bool:
    """True if an effect is of a motor that turns with several joints, and no tendon over these has such a term."""
    return term.effect.of_motor and arm.coupled(term.joint) and term.effect.name not in OF_MOTOR


OF_MOTOR = frozenset({"coulomb_friction", "viscous_friction", "rotor_inertia"})
EXPRESSED = OF_MOTOR | frozenset(
    {
        "link_inertial_error",
        "payload",
        "spring_load",
        "torque_gain",
        "torque_offset",
        "gravity_tilt",
    }
)
"""Effects that ``Correction`` expresses in full."""
OF_DRIVE = frozenset({"drive_gain", "torque_saturation", "time_delay"})
"""Effects of drives for which an actuator has an attribute."""


def remainder(fitted: FittedTerm, states: States, every: Sequence[States]) -> Float:
    """Torque (N, n) Nm of a term along one run of ``every`` beyond ``Correction``; power (N, 1) W of a supply term."""
    course = fitted.course(states)
    if fitted.term.effect.place == "supply":
        return course[:, None]
    if of_coupled(fitted.term, states.arm):
        return course
    expressed = correction(Retuned.nothing(course.shape[1]), [fitted], every)
    course -= expressed.friction * states.sign
    course -= np.einsum("nji,ji->nj", powers(states.qd), expressed.damping)
    return course


def powers(speed: Float) -> Float:
    """w, w·abs(w) and w³ (…, 3) of speeds (…,) rad/s, which ``damping`` multiplies."""
    return np.stack([speed, speed * np.abs(speed), speed**3], axis=-1)


def why_unwritten(fitted: FittedTerm, arm: Arm) -> str:
    """Why a simulator of an arm has no term for an effect."""
    effect = fitted.term.effect
    if of_coupled(fitted.term, arm):
        return "its motor turns with several joints, and a tendon over them has no such term"
    if effect.place == "supply":
        return "it is in the supply, which the simulator does not have"
    if effect.acts_on == "reading":
        return "it is in the measurement, not in the arm"
    if effect.acts_on == "drive":
        return "an actuator has no such attribute"
    if effect.form.intermittent:
        return "it is active at some times only"
    return "the simulator has no such term"


def _polynomial(exponent: float, states: Sequence[States], joint: int) -> Float:
    """Nonnegative coefficients (3,) of w, w² and w³ that approximate w to the ``exponent`` at a joint's speeds."""
    speed = np.linspace(0.0, max(float(np.max(np.abs(s.qd[:, joint]))) for s in states), 200)
    return np.asarray(nnls(powers(speed), speed**exponent)[0])
