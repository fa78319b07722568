"""Baseline: sparse regression, a group orthogonal matching pursuit over a library of effect columns, stopped by BIC.

The columns have the shapes that textbooks give; the nominal parameters are free inside their tolerances. Effects with a
hidden state or a schedule are not in the library (except Dahl friction, whose state follows from the position).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from concealed.arms import Array
from concealed.files import Robot, Run, noise_of, thinned
from concealed.law import SIGN_WIDTH, RigidBody, gravity_of
from concealed.refit import ROWS, Columns, power_columns, power_left, torque_columns

LEAST_SHARE = 0.03
"""A group must take this share of its channel's residual sum of squares."""
MOST = 6
UNEXPLAINED = 1.8
"""Residual over noise at which the baseline says `unknown` at a joint."""


@dataclass(frozen=True)
class Group:
    """Columns (N, C, k) that enter together, the effect they stand for, and what their coefficients are called."""

    effect: str
    joint: int | None
    values: Array
    names: tuple[str, ...] = ()


def at_joint(effect: str, joint: int, shapes: Sequence[Array], n: int, *names: str) -> Group:
    """A group of columns (N,) at one joint."""
    values = np.zeros((len(shapes[0]), n, len(shapes)))
    values[:, joint] = np.stack(shapes, axis=1)
    return Group(effect, joint, values, names)


def dahl(q: Array, displacement: float) -> Array:
    """(N,) bristle state from -1 to 1 along a motion."""
    out = np.zeros(len(q))
    for i, step in enumerate(np.diff(q), start=1):
        out[i] = np.sign(step) + (out[i - 1] - np.sign(step)) * np.exp(-abs(step) / displacement)
    return out


def joint_groups(robot: Robot, run: Run, rigid: Array, j: int) -> list[Group]:
    """Everything that may be missing at one joint."""
    n, q, v = robot.joints, run.q[:, j], run.v[:, j]
    sign, one = np.tanh(v / SIGN_WIDTH), np.ones(len(q))
    groups = [
        at_joint("load_dependent_friction", j, [np.abs(rigid[:, j]) * sign], n, "coefficient"),
        at_joint("asymmetric_friction", j, [0.5 * np.abs(sign)], n, "difference"),
        at_joint("torque_offset", j, [one], n, "offset"),
        at_joint("torque_drift", j, [run.t], n, "rate"),
        at_joint("torque_gain", j, [run.simulated[:, j]], n, "gain"),
        at_joint("spring_load", j, [q, one], n, "stiffness"),
        at_joint("nonlinear_viscous_friction", j, [v**3], n, "coefficient"),
        at_joint("nonlinear_viscous_friction", j, [v * np.abs(v)], n, "coefficient"),
    ]
    for name, given, shape, word in (
        ("coulomb_friction", robot.coulomb, sign, "force"),
        ("viscous_friction", robot.viscous, v, "coefficient"),
        ("rotor_inertia", robot.rotor, run.a[:, j], "inertia"),
    ):
        if given[j] == 0:
            groups.append(at_joint(name, j, [shape], n, word))
    widths, ways, seconds = (0.04, 0.08, 0.16, 0.3), (0.004, 0.012, 0.035), (120.0, 300.0)
    return [
        *groups,
        *(at_joint("stribeck_friction", j, [np.exp(-((v / w) ** 2)) * sign], n, "excess") for w in widths),
        *(at_joint("presliding_hysteresis", j, [dahl(q, w) - sign], n, "force") for w in ways),
        *(at_joint("position_periodic_torque", j, [np.sin(k * q), np.cos(k * q)], n) for k in range(2, 33)),
        *(at_joint("temperature_dependent_friction", j, [np.exp(-run.t / x) * sign], n) for x in seconds),
    ]


def robot_groups(robot: Robot, run: Run, rigid: Array, nominal: Columns) -> list[Group]:
    """What may be missing of the whole arm: masses, level, and the clock of the torque."""
    n, links = robot.joints, nominal.values
    masses = [links[:, :, 7 * j : 7 * j + 4] for j in range(n)]
    small = 0.01
    tilts = [
        (RigidBody(robot, gravity=gravity_of(*angles)).torque(run.q, run.v, run.a) - rigid) / small  # type: ignore[arg-type]
        for angles in ((small, 0.0), (0.0, small))
    ]
    slope = -np.gradient(run.simulated, run.t, axis=0)[:, :, None]
    return [
        Group("payload", None, masses[-1], ("mass",)),
        *(Group("link_inertial_error", j, masses[j]) for j in range(1, n - 1)),
        Group("gravity_tilt", None, np.stack(tilts, axis=2), ("roll", "pitch")),
        Group("time_delay", None, slope, ("delay",)),
        Group("clock_drift", None, slope * run.t[:, None, None], ("rate",)),
    ]


def torque_groups(robot: Robot, run: Run, nominal: Columns) -> list[Group]:
    """The whole library of the torque."""
    rigid = RigidBody(robot).torque(run.q, run.v, run.a)  # type: ignore[arg-type]
    return robot_groups(robot, run, rigid, nominal) + [
        g for j in range(robot.joints) for g in joint_groups(robot, run, rigid, j)
    ]


def power_groups(robot: Robot, run: Run) -> list[Group]:
    """The whole library of the supply."""
    copper = (run.measured / robot.constant) ** 2
    drive = np.sum(run.measured * run.v + robot.resistance * copper, axis=1)
    moving = np.any(np.abs(run.v) > 0.01, axis=1).astype(float)
    entry = lambda name, *shapes, names=(): Group(name, None, np.stack(shapes, axis=1)[:, None], names)  # noqa: E731
    groups = [
        entry("brake_power", moving, names=("power",)),
        entry("iron_loss", np.sum(np.abs(run.v) ** 1.5 * robot.rotor, axis=1)),
        entry("converter_efficiency", np.abs(drive)),
        entry("regeneration_dissipated", np.maximum(-drive, 0.0)),
        entry("winding_temperature", (1 - np.exp(-run.t / 150.0)) * np.sum(copper, axis=1)),
    ]
    if robot.standby == 0:
        groups.append(entry("standby_power", np.ones(len(run.t)), names=("power",)))
    if not robot.resistance.any():
        groups.append(entry("copper_loss", *copper.T))
    return groups


@dataclass(frozen=True)
class Pursuit:
    """What was picked, in order, and the coefficients of nuisance and picked columns with their covariance."""

    picked: list[int]
    coefficients: Array
    covariance: Array
    residual: Array


def pursue(nuisance: Array, spread: Array, groups: Sequence[Group], residual: Array, noise: Array) -> Pursuit:
    """Greedy choice of groups for residual (N, C) in units of noise (C,), nuisance (N, C, P) inside its priors."""
    white = lambda x: (x / noise[None, :, None]).reshape(-1, x.shape[2])  # noqa: E731
    own = [nuisance.shape[2] + sum(g.values.shape[2] for g in groups[:k]) for k in range(len(groups))]
    a = np.concatenate([white(nuisance), *(white(g.values) for g in groups)], axis=1)
    scale = np.maximum(np.sqrt(np.mean(a**2, axis=0)), 1e-12)
    b = (residual / noise).ravel()
    gram, right = (a / scale).T @ (a / scale), (a / scale).T @ b
    prior = np.zeros(a.shape[1])
    prior[: len(spread)] = 1.0 / (spread * scale[: len(spread)]) ** 2
    ids = [list(range(own[k], own[k] + g.values.shape[2])) for k, g in enumerate(groups)]

    def cost(use: list[int]) -> float:
        system = gram[np.ix_(use, use)] + np.diag(prior[use] + 1e-9)
        return float(b @ b - right[use] @ np.linalg.solve(system, right[use]))

    used: list[int] = list(range(len(spread)))
    picked: list[int] = []
    now = cost(used)
    while len(picked) < MOST:
        taken = {(groups[k].effect, groups[k].joint) for k in picked}
        free = [k for k, g in enumerate(groups) if (g.effect, g.joint) not in taken]
        costs = {k: cost(used + ids[k]) for k in quick(gram, right, prior, used, ids, free)}
        best = min(costs, key=lambda k: costs[k] + len(ids[k]) * np.log(len(b)))
        if now - costs[best] < max(len(ids[best]) * np.log(len(b)), LEAST_SHARE * now / len(noise)):
            break
        used, picked, now = used + ids[best], [*picked, best], costs[best]
    system = gram[np.ix_(used, used)] + np.diag(prior[used] + 1e-9)
    covariance = np.linalg.inv(system)
    x = covariance @ right[used]
    left = b - (a[:, used] / scale[used]) @ x
    return Pursuit(
        picked, x / scale[used], covariance / np.outer(scale[used], scale[used]), left.reshape(residual.shape)
    )


def quick(
    gram: Array, right: Array, prior: Array, used: list[int], ids: list[list[int]], free: list[int], keep: int = 12
) -> list[int]:
    """The groups that promise most, by their gain against the present residual alone."""
    inverse = np.linalg.inv(gram[np.ix_(used, used)] + np.diag(prior[used] + 1e-9))
    gains = []
    for k in free:
        cross = gram[np.ix_(ids[k], used)] @ inverse
        left = right[ids[k]] - cross @ right[used]
        block = gram[np.ix_(ids[k], ids[k])] - cross @ gram[np.ix_(used, ids[k])] + 1e-6 * np.eye(len(ids[k]))
        gains.append(float(left @ np.linalg.solve(block, left)) - len(ids[k]) * 10.0)
    return [free[i] for i in np.argsort(gains)[::-1][:keep]]


@dataclass(frozen=True)
class Sparse:
    """The baseline's model of one case."""

    robot: Robot
    torque: Pursuit
    power: Pursuit
    findings: list[dict[str, object]]

    def left(self, run: Run) -> tuple[Array, Array]:
        """Residual torque (N, n) and power (N,) of a run; the power follows from the predicted torque."""
        columns = torque_columns(self.robot, run)
        picked = select(columns.values, torque_groups(self.robot, run, columns), self.torque)
        torque = run.simulated + picked @ self.torque.coefficients
        blind = replace(run, measured=torque)
        supply = select(power_columns(self.robot, blind).values, power_groups(self.robot, blind), self.power)
        left = power_left(self.robot, blind)[:, None] - supply @ self.power.coefficients
        return run.measured - torque, left[:, 0]


def select(nuisance: Array, groups: Sequence[Group], fit: Pursuit) -> Array:
    """Nuisance columns and those picked, (N, C, …)."""
    return np.concatenate([nuisance, *(groups[k].values for k in fit.picked)], axis=2)


def findings_of(groups: Sequence[Group], fit: Pursuit, nuisances: int) -> list[dict[str, object]]:
    """The picked groups as the contract's findings."""
    out: list[dict[str, object]] = []
    first = nuisances
    for k in fit.picked:
        g = groups[k]
        parameters = {
            name: {
                "value": float(fit.coefficients[first + i]),
                "std": float(np.sqrt(fit.covariance[first + i, first + i])),
            }
            for i, name in enumerate(g.names)
        }
        first += g.values.shape[2]
        joint = None if g.joint is None else g.joint + 1
        out.append({"effect": g.effect, "joint": joint, "kind": "missing", "parameters": parameters})
    return out


def explain(robot: Robot, runs: Sequence[Run]) -> Sparse:
    """Pick effects for the torque, then for the power."""
    total = sum(len(r.t) for r in runs)
    few = [thinned(r, max(200, ROWS * len(r.t) // total)) for r in runs]
    noise = np.mean([noise_of(r.measured - r.simulated) for r in runs], axis=0)
    meter = np.mean([noise_of(power_left(robot, r)[:, None]) for r in runs], axis=0)
    columns = [torque_columns(robot, r) for r in few]
    torque = fit(
        columns,
        [torque_groups(robot, r, c) for r, c in zip(few, columns, strict=True)],
        [r.measured - r.simulated for r in few],
        noise,
    )
    power = fit(
        [power_columns(robot, r) for r in few],
        [power_groups(robot, r) for r in few],
        [power_left(robot, r)[:, None] for r in few],
        meter,
    )
    findings = torque[1] + power[1]
    size = np.sqrt(np.mean(torque[0].residual ** 2, axis=0))
    findings += [
        {"effect": "unknown", "joint": int(j) + 1, "kind": "missing"} for j in np.flatnonzero(size > UNEXPLAINED)
    ]
    return Sparse(robot, torque[0], power[0], findings)


def fit(
    nuisances: Sequence[Columns], libraries: Sequence[Sequence[Group]], residuals: Sequence[Array], noise: Array
) -> tuple[Pursuit, list[dict[str, object]]]:
    """One pursuit over all runs put together, and its findings."""
    together = [
        Group(g.effect, g.joint, np.concatenate([lib[k].values for lib in libraries]), g.names)
        for k, g in enumerate(libraries[0])
    ]
    columns = np.concatenate([c.values for c in nuisances])
    found = pursue(columns, nuisances[0].spread, together, np.concatenate(residuals), noise)
    return found, findings_of(together, found, columns.shape[2])
