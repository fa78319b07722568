"""Currents and power fitted together: Gauss–Newton on all coefficients of torque and supply, with their priors."""

from __future__ import annotations

from typing import Final

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.models.power import supply as supplies
from cellwatt_plugins.models.power import torque as torques
from cellwatt_plugins.models.power.problem import Problem
from cellwatt_plugins.models.power.supply import Sharing, Supply
from cellwatt_plugins.models.power.torque import Solution
from cellwatt_plugins.robot.drive import Drives
from cellwatt_plugins.robot.regression import Prior, Products, gauss_newton

ROUNDS: Final = 6
ROUNDS_BLIND: Final = 24
"""Largest number of rounds if no current was measured: the start is then far from the result."""
STILL: Final = 1e-5
"""Step of all coefficients, in prior standard deviations, below which the fit ends."""


def fit_together(
    problem: Problem, chosen: list[int], start: Solution, losses: tuple[str, ...], sharing: Sharing
) -> tuple[Solution, Supply, Float]:
    """Torque, supply and standard errors (p,) of ``Solution.row`` and ``Supply.vector``, from separate fits of both.

    Rows without power count for the currents only.
    """
    rows, shown, known = problem.rows, problem.rows.shown, problem.rows.shown.rows
    qd, count, shared = rows.qd[known], len(start.row), len(start.shared)
    columns = _columns(problem, chosen, shared)
    drive = problem.drive(columns @ start.row, qd)
    mean, own = believed = supplies.believed(drive, shown.power, losses, sharing, problem.arm.description)
    prior = Prior.joined(torques.prior_of(problem.belief, chosen), own)
    currents = torques.together(problem.everything(), shared, chosen).placed(slice(0, count), len(prior.mean))

    def linearised(x: Float) -> Products:
        supply = mean.with_vector(x[count:])
        drive = problem.drive(columns @ x[:count], qd)
        residual = shown.power - supplies.through(shown.matrix, supply.power(drive))[:, 0]
        by_number, by_taken = supply.slopes(drive)
        by_torque = by_taken * _taken_by_torque(problem, supply, drive)
        slope = np.concatenate([np.einsum("nj,njp->np", by_torque, columns), by_number], axis=1)
        slope = supplies.through(shown.matrix, slope)
        return currents + Products.of(slope, residual + slope @ x, float(np.mean(residual**2)) + 1e-18)

    first = np.concatenate([start.row, supplies.fit(drive, shown.power, believed, shown.matrix)[0].vector()])
    rounds = ROUNDS if np.isfinite(rows.torque).any() else ROUNDS_BLIND
    x, last = gauss_newton(linearised, prior, first, rounds, STILL, lambda x: supplies.possible(x, count))
    torque = Solution.of(x[:count], shared, problem.arm.joints, chosen)
    return torque, mean.with_vector(x[count:]), last.deviations


def _columns(problem: Problem, chosen: list[int], shared: int) -> Float:
    """(N, n, p): torque for 1 of each coefficient of ``Solution.row``, in the rows with power."""
    design, known, terms = problem.design, problem.rows.shown.rows, len(chosen)
    joints = problem.arm.joints
    columns = np.zeros((len(known), joints, shared + joints * terms))
    columns[:, :, :shared] = design.shared[known]
    for j in range(joints):
        columns[:, j, shared + j * terms : shared + (j + 1) * terms] = design.own[known, j][:, chosen]
    return columns


def _taken_by_torque(problem: Problem, supply: Supply, drive: Drives) -> Float:
    """Derivative (N, n) of the power drawn by each drive, by its torque."""
    weight = dict(zip(supply.terms, supply.weights, strict=True))
    resistance, constant = supplies.resistances(problem.arm.description), problem.constant
    out = weight["mechanical"] * drive.qd + weight["copper"] * 2 * drive.current * resistance / constant
    if "switching" in weight:
        out = out + weight["switching"] * np.sign(drive.current) / constant
    return np.asarray(out)
