"""Currents and power fitted together: Gauss–Newton on all numbers of torque and supply, with their priors."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from cellwatt_plugins.models.power import supply as supplies
from cellwatt_plugins.models.power import torque as torques
from cellwatt_plugins.models.power.problem import Problem
from cellwatt_plugins.models.power.supply import Believed, Sharing, Supply
from cellwatt_plugins.models.power.torque import Solution
from cellwatt_plugins.robot.drive import Drives

Float = NDArray[np.float64]

ROUNDS: Final = 6
ROUNDS_BLIND: Final = 24
"""Rounds where no current was measured and the start is far."""
STILL: Final = 1e-5
"""Steps of all numbers, in prior standard deviations, below which it has ended."""


@dataclass(frozen=True)
class Together:
    """Result with standard errors (p,): the torque's numbers joint by joint, then ``Supply.vector``."""

    torque: Solution
    supply: Supply
    errors: Float


def fit_together(
    problem: Problem, chosen: list[int], start: Solution, losses: tuple[str, ...], sharing: Sharing
) -> Together:
    """From separate fits of both; rows without power count for the currents only."""
    step = _Step.of(problem, chosen, start, losses, sharing)
    x, errors = step.start(start), step.spread
    measured = bool(np.isfinite(problem.rows.torque).any())
    for _ in range(ROUNDS if measured else ROUNDS_BLIND):
        x, errors, moved = step.taken(x)
        if moved < STILL:
            break
    torque = torques.split(x[: step.count], len(start.shared), problem.body.joints, chosen)
    return Together(torque, step.supply(x), errors)


@dataclass(frozen=True)
class _Step:
    """Everything that stays the same from one Gauss–Newton step to the next; p numbers, ``count`` of them torque's."""

    problem: Problem
    belief: Believed
    columns: Float
    """(N, n, count): torque for 1 of each number, in the rows with power."""
    qd: Float
    power: Float
    meter: csr_array | None
    matrix: Float
    vector: Float
    """Of the currents' least squares: (count, count), (count,)."""
    mean: Float
    spread: Float
    """(p,)."""

    @classmethod
    def of(
        cls, problem: Problem, chosen: list[int], start: Solution, losses: tuple[str, ...], sharing: Sharing
    ) -> _Step:
        rows, design = problem.rows, problem.design
        shown, known = rows.shown, rows.shown.rows
        joints, shared, terms = problem.body.joints, len(start.shared), len(chosen)
        drive = problem.drive(start.torque(design)[known], rows.qd[known])
        belief = supplies.believed(drive, shown.power, losses, sharing, problem.stated)
        matrix, vector = torques.layout(problem.everything(), shared, chosen)
        mean, spread = torques.believed(problem.belief, chosen)
        columns = np.zeros((len(known), joints, len(mean)))
        columns[:, :, :shared] = design.shared[known]
        for j in range(joints):
            columns[:, j, shared + j * terms : shared + (j + 1) * terms] = design.own[known, j][:, chosen]
        mean = np.concatenate([mean, belief.mean.vector()])
        spread = np.concatenate([spread, belief.spread])
        measured = shown.power, shown.matrix
        return cls(problem, belief, columns, rows.qd[known], *measured, matrix, vector, mean, spread)

    @property
    def count(self) -> int:
        return len(self.vector)

    def start(self, torque: Solution) -> Float:
        """All numbers, the supply's fitted to the torques."""
        x = np.concatenate([torque.shared, torque.own.T.ravel()])
        drive = self.problem.drive(self.columns @ x, self.qd)
        return np.concatenate([x, supplies.fit(drive, self.power, self.belief, meter=self.meter)[0].vector()])

    def supply(self, x: Float) -> Supply:
        return self.belief.mean.with_vector(x[self.count :])

    def taken(self, x: Float) -> tuple[Float, Float, float]:
        """The next numbers, their standard errors, and the largest step in prior standard deviations."""
        count, supply = self.count, self.supply(x)
        drive = self.problem.drive(self.columns @ x[:count], self.qd)
        left = self.power - supplies.through(self.meter, supply.power(drive))[:, 0]
        noise = float(np.sqrt(np.mean(left**2))) + 1e-9
        by_number, by_taken = supply.slopes(drive)
        by_torque = by_taken * self._taken_by_torque(supply, drive)
        jacobian = np.concatenate([np.einsum("nj,njp->np", by_torque, self.columns), by_number], axis=1)
        jacobian = supplies.through(self.meter, jacobian) / noise
        gradient = jacobian.T @ (left / noise)
        gradient[:count] += self.vector - self.matrix @ x[:count]
        normal = jacobian.T @ jacobian
        normal[:count, :count] += self.matrix
        normal = self.spread[:, None] * normal * self.spread + np.eye(len(x))
        inverse = np.linalg.inv(normal)
        step = inverse @ (self.spread * gradient - (x - self.mean) / self.spread)
        x = x + self.spread * step
        x[count + 2] = np.clip(x[count + 2], 0.0, max(x[count + 1], 0.0))
        return x, self.spread * np.sqrt(np.diag(inverse)), float(np.abs(step).max())

    def _taken_by_torque(self, supply: Supply, drive: Drives) -> Float:
        """Derivative (N, n) of what a drive takes by its torque."""
        weight = dict(zip(supply.terms, supply.weights, strict=True))
        resistance, constant = self.problem.stated.resistances(), self.problem.constant
        out = weight["mechanical"] * drive.qd + weight["copper"] * 2 * drive.current * resistance / constant
        if "switching" in weight:
            out = out + weight["switching"] * np.sign(drive.current) / constant
        return np.asarray(out)
