"""Data of a fit of currents: rows, columns, priors and weights."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float, rows_of
from cellwatt_plugins.models.power import torque as torques
from cellwatt_plugins.models.power.design import Belief, Design, Rows, possible, spread_of
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.smoothing import noise_of
from cellwatt_plugins.models.power.supply import resistances
from cellwatt_plugins.models.power.terms import terms_of
from cellwatt_plugins.models.power.torque import Solution, Sums
from cellwatt_plugins.models.power.tuning import Tuning
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.drive import Drives

MOST: Final = 20_000
"""Largest number of rows of a fit."""
LEAST_SPREAD: Final = 0.5
"""Smallest spread of a joint's current, as a share of the median joint's: a joint at rest has friction, too."""


@dataclass(frozen=True)
class Problem:
    """Data and priors of the fit, and the weight of each row."""

    arm: Arm
    rows: Rows
    design: Design
    belief: Belief
    variance: Float
    """(N, n) Nm²: variance of the torque residuals."""
    constant: Float
    """(n,) Nm/A."""
    scale: Float
    """(n,) Nm: size of the torques, measured or from the URDF; no drive's is far below the others'."""
    effects: tuple[str, ...]
    """Effects to choose from."""

    @classmethod
    def of(
        cls, moves: Moves, arm: Arm, tuning: Tuning, doubt: float, effects: tuple[str, ...] | None = None
    ) -> Problem:
        """With columns for ``effects``, or for all that the rows can show; ``doubt`` is a factor on links'
        tolerances."""
        constant = arm.column("torque_constant")
        rows = Rows.of(moves, tuning.smoother, constant, MOST)
        able = possible(rows, tuning.width) if effects is None else effects
        design, inertial = Design.stated(rows, arm.body, tuning.width, terms_of(able))
        torque = rows.torque if np.isfinite(rows.torque).any() else design.shared @ inertial
        current = spread_of(torque / constant)
        scale = np.maximum(current, LEAST_SPREAD * np.median(current)) * constant + 1e-6
        noise = np.nan_to_num(noise_of(moves.current * constant), nan=1e-6)
        variance = np.broadcast_to((0.05 * scale) ** 2 + noise**2, rows.q.shape)
        belief = Belief.of(arm, design, scale, doubt)
        return cls(arm, rows, design, belief, variance, constant, scale, able).reweighed(effects or ())

    def chosen(self, effects: tuple[str, ...]) -> list[int]:
        """Indices, among the columns, of the terms of every model and of those of some effects."""
        return [self.design.names.index(name) for name in terms_of(effects)]

    def sums(self, rows: NDArray[np.bool_]) -> Sums:
        """Sums over some rows."""
        return torques.sums_of(self.design, self.rows.torque, self.variance, rows)

    def everything(self) -> Sums:
        """Sums over all rows."""
        return self.sums(np.ones(len(self.rows), bool))

    def solution(self, effects: tuple[str, ...]) -> Solution:
        """The torque's coefficients from the currents alone."""
        return torques.solve(self.everything(), self.belief, self.chosen(effects))

    def reweighed(self, effects: tuple[str, ...]) -> Problem:
        """The same with the load of the current coefficients, and rows weighed by their residuals."""
        solution, rows, design = self.solution(effects), self.rows, self.design
        residual = rows.torque - solution.torque(design)
        known = np.isfinite(residual).any(axis=0)
        least = np.ones(residual.shape[1])
        least[known] = 1e-3 * np.sqrt(np.nanmean(residual[:, known] ** 2, axis=0))
        loaded = Design.of(rows, design.shared, solution.shared, design.width, design.names)
        return replace(self, variance=torques.variance_by_speed(residual, rows.qd, least), design=loaded)

    def doubting(self, doubt: float) -> Belief:
        """Return the prior with ``doubt`` as the factor on links' tolerances."""
        return Belief.of(self.arm, self.design, self.scale, doubt)

    def drive(self, torque: Solution, rows: NDArray[np.intp]) -> Drives:
        """Return the state of the drives in some rows; the work is that of the torque by the fitted constants."""
        stated = torque.torque(rows_of(self.design, rows))
        resistance = resistances(self.arm.description)
        return Drives.of(stated / (1 + torque.own[0]), self.rows.qd[rows], stated / self.constant, resistance)
