"""Currents and power fitted together: Gauss–Newton on all coefficients of torque and supply, with their priors."""

from __future__ import annotations

from typing import Final

import numpy as np

from cellwatt.arrays import Float, rows_of
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
    shown, sums, count = problem.rows.shown, problem.everything(), len(start.row)
    design, drive = rows_of(problem.design, shown.rows), problem.drive(start, shown.rows)
    mean, own = believed = supplies.believed(drive, shown.power, losses, sharing, problem.arm.description)
    prior = Prior.joined(torques.prior_of(problem.belief, chosen), own)

    def linearised(x: Float) -> Products:
        supply, torque = mean.with_vector(x[count:]), Solution.of(x[:count], problem.belief, chosen)
        drive = problem.drive(torque, shown.rows)
        residual = shown.power - supplies.through(shown.matrix, supply.power(drive))[:, 0]
        by_number, by_taken = supply.slopes(drive)
        by_work, by_current = _taken(supply, drive, problem)
        slope = torque.slopes(design, by_taken * (by_work * drive.qd / (1 + torque.own[0]) + by_current))
        slope[:, torque.at_gain] -= by_taken * by_work * drive.mechanical / (1 + torque.own[0])
        slope = supplies.through(shown.matrix, np.concatenate([slope, by_number], axis=1))
        power = Products.of(slope, residual + slope @ x, float(np.mean(residual**2)) + 1e-18)
        return torques.about(sums, torque).placed(slice(0, count), len(x)) + power

    first = np.concatenate([start.row, supplies.fit(drive, shown.power, believed, shown.matrix)[0].vector()])
    rounds = ROUNDS if np.isfinite(problem.rows.torque).any() else ROUNDS_BLIND
    x, last = gauss_newton(linearised, prior, first, rounds, STILL, lambda fit: supplies.possible(fit, count))
    return Solution.of(x[:count], problem.belief, chosen), mean.with_vector(x[count:]), last.deviations


def _taken(supply: Supply, drive: Drives, problem: Problem) -> tuple[Float, Float]:
    """Derivatives of the power drawn by each drive: by its work (n,), and by its torque through the current (N, n)."""
    weight = dict(zip(supply.terms, supply.weights, strict=True))
    resistance, constant = supplies.resistances(problem.arm.description), problem.constant
    by_current = weight["copper"] * 2 * drive.current * resistance
    if "switching" in weight:
        by_current = by_current + weight["switching"] * np.sign(drive.current)
    return weight["mechanical"], np.asarray(by_current / constant)
