"""Mount of an arm: the direction of gravity in the base's frame, identified from torques."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.robot.body import Body
from cellwatt_plugins.robot.motion import direction

ROWS = 3000
"""Approximate number of samples from which a mount is identified."""
LEANS = 0.18
"""Tilt in rad below which the arm stands on a floor that is not level, and its mount is as assumed."""
MOST = 0.25
"""Largest remaining share of the mean square torque residual, over the joints that gravity loads, of a new mount."""
ROUNDS = 3
STIFF = 1e-6
"""Share of the information that holds gravity at its assumed value in directions that load no joint."""


@dataclass(frozen=True)
class Mount:
    """A mount that differs from the assumed one."""

    field: Float
    """Acceleration of gravity (3,) m/s² in the base's frame."""
    std: Float
    """Standard deviation (3,) m/s²."""


def mount(body: Body, q: Float, qd: Float, qdd: Float, residual: Float) -> Mount | None:
    """Identify another mount from ``residual`` (N, n) Nm, torque minus that of the ``body`` as assumed; else None.

    Friction, rotor inertia and a constant torque of each joint are free. ``q`` rad and its derivatives in s are (N, n);
    NaN torques are ignored.
    """
    thin = max(1, len(q) // ROWS)
    q, qd, qdd, residual = q[::thin], qd[::thin], qdd[::thin], residual[::thin]
    known = np.all(np.isfinite(residual) | ~np.isfinite(residual).any(axis=0), axis=1)
    measured = np.flatnonzero(np.isfinite(residual[known]).all(axis=0)) if known.any() else np.empty(0, np.intp)
    if not len(measured) or not body.gravity_field.any():
        return None
    q, qd, qdd, residual = q[known], qd[known], qdd[known], residual[known][:, measured]
    loads = np.stack([body.with_gravity(axis).gravity(q)[:, measured] for axis in np.eye(3)], axis=2)
    free = [np.column_stack([direction(qd[:, j]), qd[:, j], qdd[:, j], np.ones(len(q))]) for j in measured]
    # Friction, rotor inertia and a constant torque are projected out of both sides, joint by joint.
    bare, target = [], []
    for c, columns in enumerate(free):
        basis = np.linalg.svd(columns, full_matrices=False)[0]
        bare.append(loads[:, c] - basis @ (basis.T @ loads[:, c]))
        target.append(residual[:, c] - basis @ (basis.T @ residual[:, c]))
    return _identified(body.gravity_field, bare, target)


def _identified(assumed: Float, loads: Sequence[Float], target: Sequence[Float]) -> Mount | None:
    """The mount that explains each joint's torque residual (N,) by its loads (N, 3) for 1 m/s² along each axis."""
    before = np.array([np.mean(part**2) for part in target])
    variance = np.maximum(before, 1e-12)
    change, information = np.zeros(3), np.eye(3)
    for _ in range(ROUNDS):
        information = np.asarray(sum(x.T @ x / v for x, v in zip(loads, variance, strict=True)))
        pull = np.asarray(sum(x.T @ y / v for x, y, v in zip(loads, target, variance, strict=True)))
        information = information + STIFF * max(np.trace(information), 1e-12) * np.eye(3)
        change = np.linalg.solve(information, pull)
        after = np.array([np.mean((y - x @ change) ** 2) for x, y in zip(loads, target, strict=True)])
        variance = np.maximum(after, 1e-6 * before + 1e-12)
    size = float(np.linalg.norm(assumed))
    field = assumed + change
    field = field * size / max(float(np.linalg.norm(field)), 1e-9)
    after = np.array([np.mean((y - x @ (field - assumed)) ** 2) for x, y in zip(loads, target, strict=True)])
    weight = np.array([np.mean(x**2) for x in loads])
    weight = weight > 0.01 * weight.max(initial=0.0)
    left = float(np.sum(after[weight]) / max(np.sum(before[weight]), 1e-300))
    leans = float(np.arccos(np.clip(field @ assumed / size**2, -1, 1)))
    if leans < LEANS or left > MOST:
        return None
    # Samples of one motion are far from independent: ten count as one.
    return Mount(field, np.sqrt(10 * np.diag(np.linalg.inv(information))))
