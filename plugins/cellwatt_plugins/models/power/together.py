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
    rows, shown = problem.rows, problem.rows.shown
    qd, design, count = rows.qd[shown.rows], problem.design.at(shown.rows), len(start.row)
    drive = problem.drive(start.torque(design), qd)
    mean, own = believed = supplies.believed(drive, shown.power, losses, sharing, problem.arm.description)
    prior = Prior.joined(torques.prior_of(problem.belief, chosen), own)
    sums = problem.everything()

    def linearised(x: Float) -> Products:
        supply, torque = mean.with_vector(x[count:]), Solution.of(x[:count], problem.belief, chosen)
        drive = problem.drive(torque.torque(design), qd)
        residual = shown.power - supplies.through(shown.matrix, supply.power(drive))[:, 0]
        by_number, by_taken = supply.slopes(drive)
        by_torque = by_taken * _taken_by_torque(problem, supply, drive)
        slope = supplies.through(shown.matrix, np.concatenate([torque.slopes(design, by_torque), by_number], axis=1))
        power = Products.of(slope, residual + slope @ x, float(np.mean(residual**2)) + 1e-18)
        return torques.about(sums, torque).placed(slice(0, count), len(x)) + power

    first = np.concatenate([start.row, supplies.fit(drive, shown.power, believed, shown.matrix)[0].vector()])
    rounds = ROUNDS if np.isfinite(rows.torque).any() else ROUNDS_BLIND
    x, last = gauss_newton(linearised, prior, first, rounds, STILL, lambda x: supplies.possible(x, count))
    return Solution.of(x[:count], problem.belief, chosen), mean.with_vector(x[count:]), last.deviations


def _taken_by_torque(problem: Problem, supply: Supply, drive: Drives) -> Float:
    """Derivative (N, n) of the power drawn by each drive, by its torque."""
    weight = dict(zip(supply.terms, supply.weights, strict=True))
    resistance, constant = supplies.resistances(problem.arm.description), problem.constant
    out = weight["mechanical"] * drive.qd + weight["copper"] * 2 * drive.current * resistance / constant
    if "switching" in weight:
        out = out + weight["switching"] * np.sign(drive.current) / constant
    return np.asarray(out)
