"""Fit of the supply (``robot.drive``) to measured power: its losses, and which drives use regenerated power."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from cellwatt.arrays import Float, rows_of
from cellwatt.scheduler import spread
from cellwatt_plugins.models.power.folds import GAIN, grown
from cellwatt_plugins.models.power.terms import DRIVE_ALWAYS, LOSSES
from cellwatt_plugins.robot import RobotDescription
from cellwatt_plugins.robot.drive import TERMS, Drives, drawn
from cellwatt_plugins.robot.regression import Fit, Prior, Products, gauss_newton

Sharing = Literal["bus", "joint"]

ROUNDS: Final = 12
STILL: Final = 1e-6
"""Step of all coefficients, in prior standard deviations, below which the fit ends."""
GAIN_SPREAD: Final = 0.03
"""Standard deviation of a stated torque constant, as a share."""
WARMER: Final = 0.15
"""Rise of a winding's resistance at 40 K above its stated temperature, as a share, beside the tolerance."""
GUESSED: Final = 1.0
"""Assumed resistance in Ω of a winding without a stated one; its standard deviation is the same."""
LOSS: Final = 3.0
"""Prior standard deviation of one joint's loss, W."""
BRAKES: Final = "brakes held open while the arm moves"
POSSIBLE: Final = (*LOSSES, BRAKES)
MOVING: Final = 0.02
"""Sum of the joints' velocities in rad/s above which an arm moves."""


@dataclass(frozen=True)
class Supply:
    """A fitted supply."""

    standby: float
    """P_c, W."""
    up: float
    down: float
    brakes: float
    """W of the brakes, drawn while the arm moves."""
    terms: tuple[str, ...]
    weights: Float
    """(terms, n)."""
    sharing: Sharing
    """``bus`` if drives use the power that others return, ``joint`` if each drive dissipates its own."""

    @property
    def efficiency(self) -> float:
        """Share of the power drawn that reaches the drives."""
        return 1 / self.up

    @property
    def used(self) -> float:
        """Share of the energy returned by drives that is used."""
        return self.down / self.up

    def power(self, drive: Drives) -> Any:
        """Supply power (N, 1) W."""
        taken = sum(TERMS[name](drive) * weight for name, weight in zip(self.terms, self.weights, strict=True))
        if self.sharing == "bus":
            taken = taken.sum(axis=-1, keepdims=True)
        flow = drawn(taken, self.up, self.down)
        if self.sharing == "joint":
            flow = flow.sum(axis=-1, keepdims=True)
        return self.standby + flow + self.brakes * moving(drive)

    def vector(self) -> Float:
        """All coefficients as a vector: standby, up, down, brakes, weights."""
        return np.concatenate([[self.standby, self.up, self.down, self.brakes], self.weights.ravel()])

    def with_vector(self, x: Float) -> Supply:
        """The same supply with other coefficients."""
        standby, up, down, brakes = x[:4].tolist()
        return replace(
            self, standby=standby, up=up, down=down, brakes=brakes, weights=x[4:].reshape(self.weights.shape)
        )

    def slopes(self, drive: Drives) -> tuple[Float, Float]:
        """Derivatives of the power by all coefficients (N, p), and by the power drawn by each drive (N, n)."""
        columns = np.stack([TERMS[name](drive) for name in self.terms])
        taken = np.einsum("tnj,tj->nj", columns, self.weights)
        if self.sharing == "bus":
            taken = taken.sum(axis=1, keepdims=True)
        slope = np.broadcast_to(np.where(taken > 0, self.up, self.down), drive.qd.shape)
        fixed = [
            np.ones(len(taken)),
            np.maximum(taken, 0).sum(axis=1),
            np.minimum(taken, 0).sum(axis=1),
            moving(drive)[:, 0],
        ]
        by_weight = (columns * slope).transpose(1, 0, 2).reshape(len(taken), -1)
        return np.concatenate([np.stack(fixed, axis=1), by_weight], axis=1), np.asarray(slope)


def moving(drive: Drives) -> Any:
    """1 while any joint moves, (N, 1)."""
    return np.tanh(np.abs(drive.qd).sum(axis=-1, keepdims=True) / MOVING)


def resistances(robot: RobotDescription) -> Float:
    """Resistance (n,) Ω of the windings, assumed where unknown."""
    stated = robot.column("winding_resistance")
    return np.where(stated > 0, stated, GUESSED)


Believed = tuple[Supply, Prior]
"""A supply before the data, and the prior of its ``vector``."""


def believed(
    drive: Drives, power: Float, effects: Sequence[str], sharing: Sharing, robot: RobotDescription
) -> Believed:
    """Prior of the supply: stated numbers of the drives are about right, losses are small."""
    names = (*DRIVE_ALWAYS, *(term for effect in effects if effect in LOSSES for term in LOSSES[effect]))
    weights = np.array([[float(name in DRIVE_ALWAYS)] * drive.qd.shape[1] for name in names])
    copper = np.where(robot.column("winding_resistance") > 0, np.hypot(robot.tolerances.supply, WARMER), 1.0)
    known = {"mechanical": np.full(copper.shape, GAIN_SPREAD), "copper": copper}
    spreads = []
    for name in names:
        size = np.sqrt(np.mean(TERMS[name](drive) ** 2, axis=0))
        # A joint that hardly moved may have as much loss as the others once it moves.
        spreads.append(known[name] if name in known else LOSS / np.maximum(size, 0.5 * size.max() + 1e-6))
    level = float(np.median(power))
    mean = Supply(robot.standby_power or level, 1.1, 0.55, 0.0, names, weights, sharing)
    brakes = LOSS if BRAKES in effects else 1e-6
    fixed = [max(0.5 * level, 1.0), 0.15, 0.55, brakes]
    return mean, Prior.spread(np.concatenate([fixed, *spreads]), mean.vector())


def fit(drive: Drives, power: Float, belief: Believed, meter: csr_array | None = None) -> tuple[Supply, float]:
    """Return the most probable supply, and the rms in W of its residuals, which is also the noise.

    ``power`` (M,) W belongs to the N rows, or is averaged from them by a slow ``meter`` (M, N).
    """
    mean, prior = belief

    def residual(supply: Supply) -> Float:
        return np.asarray(power - through(meter, supply.power(drive))[:, 0])

    def linearised(x: Float) -> Products:
        supply = mean.with_vector(x)
        slope, rest = through(meter, supply.slopes(drive)[0]), residual(supply)
        return Products.of(slope, rest + slope @ x, float(np.mean(rest**2)) + 1e-18)

    x, _ = gauss_newton(linearised, prior, prior.mean, ROUNDS, STILL, possible)
    found = mean.with_vector(x)
    return found, float(np.sqrt(np.mean(residual(found) ** 2)))


def possible(fit: Fit, at: int = 0) -> Float:
    """Return the most probable coefficients, the supply's from index ``at``: brakes and losses take power, and what
    drives return is worth at most what they draw."""
    x = fit.bounded(np.repeat([-np.inf, 0.0], [at + 2, len(fit.coefficients) - at - 2])).copy()
    x[at + 2] = min(x[at + 2], max(x[at + 1], 0.0))
    return x


def through(meter: csr_array | None, rows: Float) -> Float:
    """Rows (N, k) averaged as a slow meter (M, N) does."""
    return rows if meter is None else np.asarray(meter @ rows)


def select(
    drive: Drives, power: Float, fold: NDArray[np.int64], robot: RobotDescription, meter: csr_array | None = None
) -> tuple[tuple[str, ...], Sharing]:
    """Losses that lower the held-out error, and how drives share regenerated power; ``power`` as in ``fit``."""
    measured = drive, power, fold, robot, meter

    def chosen(sharing: Sharing) -> tuple[list[str], Float]:
        def scores(sets: Sequence[Sequence[str]]) -> list[Float]:
            return spread(_score, [(tuple(found), sharing) for found in sets], "losses", shared=measured)

        return grown(scores, lambda found: POSSIBLE)

    (one, errors_bus), (each, errors_joint) = chosen("bus"), chosen("joint")
    return (tuple(each), "joint") if (errors_joint / errors_bus).mean() < GAIN else (tuple(one), "bus")


def _score(
    trial: tuple[tuple[str, ...], Sharing],
    measured: tuple[Drives, Float, NDArray[np.int64], RobotDescription, csr_array | None],
) -> Float:
    """Mean square (folds,) W² of the residuals in each fold, of a supply with some losses fitted to the others."""
    drive, power, fold, robot, meter = measured

    def part(kept: NDArray[np.bool_]) -> tuple[Drives, csr_array | None]:
        return (rows_of(drive, kept), None) if meter is None else (drive, meter[kept])

    belief = believed(drive, power, *trial, robot)
    out = []
    for k in np.unique(fold):
        held = fold == k
        own, seen = part(~held)
        supply, _ = fit(own, power[~held], belief, meter=seen)
        own, seen = part(held)
        out.append(np.mean((power[held] - through(seen, supply.power(own))[:, 0]) ** 2))
    return np.array(out)
