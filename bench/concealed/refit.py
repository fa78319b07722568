"""The usual remedy: refit the nominal parameters inside generous tolerances, and name nothing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from concealed.arms import Array
from concealed.files import Robot, Run, noise_of, thinned
from concealed.law import SIGN_WIDTH, RigidBody

ROWS = 3000
TOLERANCE = {"mass": 0.05, "com": 0.008, "inertia": 0.1, "joint": 0.1, "resistance": 0.1, "standby": 0.05}
"""Prior standard deviations: shares, and m for centres of mass."""


@dataclass(frozen=True)
class Columns:
    """What each nominal parameter adds to the torque, (N, n, P) per unit, with prior standard deviations (P,)."""

    values: Array
    spread: Array


def rigid_columns(robot: Robot, run: Run) -> Columns:
    """Mass, centre of mass and diagonal inertia of each link, by differences of inverse dynamics."""
    body = RigidBody(robot)  # type: ignore[arg-type]
    base = body.torque(run.q, run.v, run.a)
    columns, spread = [], []
    for j in range(robot.joints):
        changes: list[tuple[str, Any, float]] = [("mass", j, TOLERANCE["mass"] * max(robot.mass[j], 1e-3))]
        changes += [("com", (j, k), TOLERANCE["com"]) for k in range(3)]
        changes += [("inertia", (j, k), TOLERANCE["inertia"] * robot.inertia[j, k]) for k in range(3)]
        for name, where, size in changes:
            value = getattr(robot, name).copy()
            value[where] += size
            moved = RigidBody(replace(robot, **{name: value}))  # type: ignore[arg-type]
            columns.append((moved.torque(run.q, run.v, run.a) - base) / size)
            spread.append(size)
    return Columns(np.stack(columns, axis=2), np.array(spread))


def joint_columns(robot: Robot, run: Run) -> Columns:
    """Coulomb and viscous friction and rotor inertia, where the simulation has them."""
    n = robot.joints
    columns, spread = [], []
    for values, shape in ((robot.coulomb, np.tanh(run.v / SIGN_WIDTH)), (robot.viscous, run.v), (robot.rotor, run.a)):
        for j in range(n):
            if values[j] > 0:
                column = np.zeros_like(run.v)
                column[:, j] = shape[:, j]
                columns.append(column)
                spread.append(TOLERANCE["joint"] * values[j])
    shape = np.stack(columns, axis=2) if columns else np.zeros((*run.v.shape, 0))
    return Columns(shape, np.array(spread))


def torque_columns(robot: Robot, run: Run) -> Columns:
    """All nominal parameters of the torque."""
    a, b = rigid_columns(robot, run), joint_columns(robot, run)
    return Columns(np.concatenate([a.values, b.values], axis=2), np.concatenate([a.spread, b.spread]))


def power_columns(robot: Robot, run: Run) -> Columns:
    """Standby power and winding resistances, where the simulation has them, (N, 1, P)."""
    columns, spread = [], []
    if robot.standby > 0:
        columns.append(np.ones(len(run.t)))
        spread.append(TOLERANCE["standby"] * robot.standby)
    for j in np.flatnonzero(robot.resistance > 0):
        columns.append((run.measured[:, j] / robot.constant[j]) ** 2)
        spread.append(TOLERANCE["resistance"] * robot.resistance[j])
    shape = np.stack(columns, axis=1)[:, None] if columns else np.zeros((len(run.t), 1, 0))
    return Columns(shape, np.array(spread))


def power_left(robot: Robot, run: Run) -> Array:
    """(N,) measured power beyond the simulation's, which is carried from its torque to the measured by the law."""
    more = run.measured**2 - run.simulated**2
    change = (run.measured - run.simulated) * run.v + robot.resistance / robot.constant**2 * more
    return np.asarray(run.measured_power - run.simulated_power - np.sum(change, axis=1))


def map_fit(columns: Array, residual: Array, noise: Array, spread: Array) -> Array:
    """(P,) maximum a posteriori of residual (N, C) = columns (N, C, P) · x with noise (C,) and priors (P,)."""
    a = (columns / noise[None, :, None]).reshape(residual.size, len(spread)) * spread
    b = (residual / noise).ravel()
    return np.asarray(np.linalg.solve(a.T @ a + np.eye(len(spread)), a.T @ b) * spread)


@dataclass(frozen=True)
class Refit:
    """The refitted nominal parameters, as changes from those given."""

    robot: Robot
    torque: Array
    power: Array

    def left(self, run: Run) -> tuple[Array, Array]:
        """Residual torque (N, n) and power (N,) of a run after the refit; the power is that of the predicted torque."""
        torque = run.simulated + torque_columns(self.robot, run).values @ self.torque
        blind = replace(run, measured=torque)
        power = power_left(self.robot, blind) - (power_columns(self.robot, blind).values @ self.power)[:, 0]
        return run.measured - torque, power


def refit(robot: Robot, runs: Sequence[Run]) -> Refit:
    """Fit the nominal parameters to all runs, on about ROWS samples in all."""
    noise = np.mean([noise_of(r.measured - r.simulated) for r in runs], axis=0)
    total = sum(len(r.t) for r in runs)
    few = [thinned(r, max(200, ROWS * len(r.t) // total)) for r in runs]
    columns = [torque_columns(robot, r) for r in few]
    residual = np.concatenate([r.measured - r.simulated for r in few])
    torque = map_fit(np.concatenate([c.values for c in columns]), residual, noise, columns[0].spread)
    supply = [power_columns(robot, r) for r in few]
    left = np.concatenate([power_left(robot, r) for r in few])[:, None]
    meter = np.mean([noise_of(power_left(robot, r)[:, None]) for r in runs], axis=0)
    power = map_fit(np.concatenate([c.values for c in supply]), left, meter, supply[0].spread)
    return Refit(robot, torque, power)
