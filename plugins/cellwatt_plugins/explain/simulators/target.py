"""Values of a mended simulator: the user's plus the correction found, as far as a real arm can have them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt.errors import ConfigError
from cellwatt_plugins.explain.simulators.correction import Correction, powers
from cellwatt_plugins.explain.simulators.inertia import moved, nearest, physical
from cellwatt_plugins.explain.simulators.mujoco import Simulator
from cellwatt_plugins.explain.simulators.placing import Placing
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import direction
from cellwatt_plugins.robot.servo.law import Servo

ROWS = 3000
"""Approximate number of rows of the recordings on which inertias are compared."""

WEAK = 1e-3
"""Stiffness of a spring that represents a constant torque, in units of that torque, 1/rad."""


@dataclass(frozen=True)
class Target:
    """The numbers of a mended simulator, n joints."""

    friction: Float
    """(n,) Nm."""
    damping: Float
    """(n, 3) Nm for w, w·abs(w), w³."""
    armature: Float
    """(n,) kg m²."""
    stiffness: Float
    """(n,) Nm/rad."""
    rest: Float
    """(n,) rad at which the springs are at rest."""
    links: Float
    """(n, 10), of the joints' bodies in their own frames."""
    payload: Float | None
    """(10,) in the frame of the last joint's body."""
    gravity: Float
    """(3,) m/s² in the world."""
    gear: Float
    """(n,), factor on the user's gears."""
    changed: tuple[Float, Float | None]
    """Difference of links (n, 10) and payload (10,) from the user's, in the URDF's joint frames."""
    refused: tuple[tuple[str, int | None, str], ...] = ()
    """Effects with their joints (0-based) that cannot be written, and why."""
    notes: tuple[str, ...] = ()
    servo: Servo | None = None
    """Position servos identified from motion; None: the user's."""
    coupling: Float | None = None
    """Turns (n, n) of each motor per turn of each joint: friction, damping and armature are then the motors'."""
    turnover: Float | None = None
    """(n,) rad/s within which dry friction reverses; NaN: as in the user's file."""


def target(user: Placing, found: Correction, states: Sequence[States], floor: Float) -> Target:
    """Add the correction ``found`` to the user's values. ``floor`` (n,) Nm is the noise. Raises ``ConfigError``."""
    simulator = user.simulator
    if len(set(simulator.bodies.tolist())) < len(simulator.joints):
        raise ConfigError(f"{simulator.path}: two joints move the same body: give each joint a body of its own")
    model, (_, dof) = simulator.model, simulator.places
    friction, armature = model.dof_frictionloss[dof] + found.friction, model.dof_armature[dof] + found.armature
    damping = damping_of(simulator) + found.damping
    below = {"friction loss": friction < 0, "damping": damping[:, 0] < 0, "armature": armature < 0}
    notes = [
        f"The {name} of joint {simulator.joints[joint]} came out below 0: 0 is written"
        for name, negative in below.items()
        for joint in np.flatnonzero(negative)
    ]
    damping[:, 0] = np.maximum(damping[:, 0], 0.0)
    stiffness, rest, refused = _springs(simulator, found.spring)
    own = np.stack([moved(row, frame) for row, frame in zip(simulator.links(), user.bodies, strict=True)])
    links, payload, more = _bodies(own, found, states, floor)
    inside = np.linalg.inv(user.bodies)
    return Target(
        np.maximum(friction, 0.0),
        damping,
        np.maximum(armature, 0.0),
        stiffness,
        rest,
        np.stack([moved(row, frame) for row, frame in zip(links, inside, strict=True)]),
        None if payload is None else moved(payload, inside[-1]),
        model.opt.gravity + user.base[:3, :3] @ found.gravity,
        1 / (1 + found.gain),
        (links - own, payload),
        tuple(refused),
        (*notes, *more),
        coupling=found.coupling,
    )


def expected(user: Placing, goal: Target, states: States, q: Float, qd: Float, qdd: Float) -> Float:
    """Intended torque (N, n) Nm of a motion: the user's simulator plus the written changes by the URDF's dynamics."""
    simulator = user.simulator
    model, (_, dof) = simulator.model, simulator.places
    before = np.array(model.opt.gravity)
    try:
        model.opt.gravity[:] = goal.gravity
        out = simulator.torque(q, qd, qdd, leading=False)
    finally:
        model.opt.gravity[:] = before
    links, payload = goal.changed
    regressor = states.arm.body.with_gravity(user.base[:3, :3].T @ goal.gravity).regressor(q, qd, qdd)
    out = out + regressor @ links.ravel()
    if payload is not None:
        out += regressor[:, :, -10:] @ payload
    turns = np.eye(len(dof)) if goal.coupling is None else goal.coupling
    out += _motors(goal.friction, goal.damping, goal.armature, qd @ turns.T, qdd @ turns.T) @ turns
    out -= _motors(model.dof_frictionloss[dof], damping_of(simulator), model.dof_armature[dof], qd, qdd)
    stiffness, rest = spring_of(simulator)
    return np.asarray(out + goal.stiffness * (q - goal.rest) - stiffness * (q - rest))


def _motors(friction: Float, damping: Float, armature: Float, speed: Float, gain: Float) -> Float:
    """Torque (N, n) Nm of friction and rotors at motors that turn at ``speed`` (N, n) rad/s."""
    return np.asarray(friction * direction(speed) + np.einsum("njk,jk->nj", powers(speed), damping) + armature * gain)


def damping_of(simulator: Simulator) -> Float:
    """Damping (n, 3) of the user's joints."""
    model, (_, dof) = simulator.model, simulator.places
    return np.column_stack([model.dof_damping[dof], model.dof_dampingpoly[dof]])


def spring_of(simulator: Simulator) -> tuple[Float, Float]:
    """Stiffness (n,) Nm/rad and rest (n,) rad of the user's joints."""
    numbers = [simulator.model.joint(name).id for name in simulator.joints]
    return simulator.model.jnt_stiffness[numbers].copy(), simulator.model.qpos_spring[simulator.places[0]].copy()


def _springs(simulator: Simulator, found: Float) -> tuple[Float, Float, list[tuple[str, int | None, str]]]:
    """The user's springs and those ``found`` (n, 2), combined to one per joint, and the refused ones."""
    stiffness, rest = spring_of(simulator)
    refused: list[tuple[str, int | None, str]] = []
    for joint in np.flatnonzero(found.any(axis=1)):
        more, constant = found[joint]
        # Simulators have no constant torque at a joint: a weak spring with a distant rest position replaces it.
        together = stiffness[joint] + (more or WEAK * abs(constant) * (stiffness[joint] == 0))
        if together <= 0:
            refused.append(("spring_load", int(joint), "no spring pushes away from its rest"))
            continue
        rest[joint] = (stiffness[joint] * rest[joint] - constant) / together
        stiffness[joint] = together
    return stiffness, rest, refused


def _bodies(
    own: Float, found: Correction, states: Sequence[States], floor: Float
) -> tuple[Float, Float | None, list[str]]:
    """Possible links (n, 10) and payload (10,) in the URDF's joint frames, and notes; ``own``: the user's links."""
    wanted = own + found.links
    every = wanted if found.payload is None else np.vstack([wanted, found.payload])
    if np.all(physical(every)):
        return wanted, found.payload, []
    rows = sum(len(s.time) for s in states)
    regressor = np.concatenate([s.regressor[:: max(1, rows // ROWS)] for s in states])
    if found.payload is not None:
        regressor = np.concatenate([regressor, regressor[:, :, -10:]], axis=2)
    weighted = (regressor / floor[:, None]).reshape(-1, regressor.shape[2])
    possible = nearest(every, weighted.T @ weighted / len(regressor))
    off = np.sqrt(np.mean(np.square(regressor @ (possible - every).ravel()), axis=0))
    worst = int(np.argmax(off))
    note = (
        "No bodies can have the inertias found: the nearest possible ones are written; their torques differ by "
        f"{off[worst]:.2g} {states[0].robot.unit(worst, 'Nm')} rms at most (joint {worst + 1})"
    )
    count = len(wanted)
    return possible[:count], None if found.payload is None else possible[count], [note]
