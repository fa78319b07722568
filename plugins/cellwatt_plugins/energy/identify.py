"""Fits the parameters of the drives to measured power, over all runs at once.

Measured power is the mean of ``supply_power`` over the analyzer's window; given the sign of the bus power it is linear
in all parameters but ``returned``. Weighted linear least squares is repeated until signs and offsets converge.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.progress import steps
from cellwatt_plugins.energy.clock import Offset, inside, refine, windows
from cellwatt_plugins.energy.drive import KINDS, Drive, bus_power, supply_power
from cellwatt_plugins.energy.recordings import Recorded
from cellwatt_plugins.energy.repetitions import Repetition
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.accumulate import Accumulated
from cellwatt_plugins.robot.regression import Fit, Prior, Products

ROUNDS = 8
"""Repetitions of the linear fit; the parameters converge after about five."""
SPREAD = {"copper": 0.15, "switching": 0.15, "eddy": 0.5, "hysteresis": 0.5}
"""Difference of joints from their common value, as a share of it, one standard deviation; from experience with motors
of one family …"""
FREE = 1e3
"""… and prior deviation of the common value from 0, so large that the value is free."""
LEAST_TORQUE = 0.2
"""Smallest factor on the robot's torque."""
RETURNED = (0.5, 0.5)
"""Prior of ``returned``: mean and one standard deviation."""
SHARPEST = 0.05
"""Smallest error of a run's values in the fit, W, since no model of a drive is better."""
SHIFT = 0.05
"""Residual offset of the clocks during the fit, s, one standard deviation. A shift makes some friction look like
inertia, so it must be free for the reported uncertainty of the torque factors to be correct."""
WANDERED = 0.1
"""Difference of the electronics' power between runs, W, one standard deviation …"""
WARMED = 0.02
"""… and of the resistance of all windings, as a share: 5 K."""
OWN = np.array([SHIFT, WANDERED, WARMED])
NEIGHBOURS = 10.0
"""Neighbouring values over which the model's error is correlated; the error recurs in each repetition."""


@dataclass(frozen=True)
class Belief:
    """Prior before the analyzer's power in motion is used: mean and one standard deviation each.

    ``fixed`` W comes from the measurements at rest, ``torque`` (n,) is the factor on the robot's torque, ``noise`` W
    that of one value of the analyzer.
    """

    fixed: tuple[float, float]
    torque: Float
    torque_uncertainty: Float
    noise: float


@dataclass(frozen=True)
class Observed:
    """One run with its ``feature`` (N, 5 n), clock offset, complete ``repetitions``, and ``notes`` on the others."""

    run: Recorded
    feature: Float
    offset: Offset
    repetitions: tuple[Repetition, ...]
    notes: tuple[str, ...] = ()

    def integral(self, samples: Float) -> Accumulated:
        """Running integral of ``samples`` (N,) or (N, k) at the robot's rate."""
        return Accumulated(float(self.run.motion.time[0]), self.run.motion.step, samples)

    def modelled(self, drive: Drive) -> Accumulated:
        """Running integral of the modelled supply power."""
        return self.integral(supply_power(drive, bus_power(drive, self.feature)))

    @cached_property
    def inside(self) -> NDArray[np.bool_]:
        """True for values of the analyzer whose whole window the robot recorded."""
        return inside(self.run.reading, self.offset.seconds, self.integral(self.feature[:, 0]))

    @cached_property
    def windows(self) -> tuple[Float, Float]:
        """Start and end (M,) s, robot's clock, of the windows of the values ``inside``."""
        start, end = windows(self.run.reading, self.offset.seconds)
        return start[self.inside], end[self.inside]

    @property
    def power(self) -> Float:
        """Power (M,) W of the values ``inside``."""
        return self.run.reading.power[self.inside]

    def means(self, integral: Accumulated, later: float = 0.0) -> Float:
        """Means (M,) or (M, k) over the windows of the values ``inside``, moved ``later`` s back."""
        start, end = self.windows
        return integral.between(start - later, end - later) / self.run.reading.step

    def residual(self, drive: Drive) -> Float:
        """Measured minus modelled power, (M,) W."""
        return self.power - self.means(self.modelled(drive))


@dataclass(frozen=True)
class Identified:
    """An arm's fitted drive with the ``covariance`` (2 + 5 n, 2 + 5 n) of fixed, weights and returned."""

    drive: Drive
    covariance: Float
    observed: tuple[Observed, ...]

    def drawn(self, generator: np.random.Generator, count: int) -> list[Drive]:
        """Random parameters within their uncertainty."""
        root = np.linalg.cholesky(self.covariance + 1e-12 * np.eye(len(self.covariance)))
        centre = np.concatenate([[self.drive.fixed], self.drive.weights(), [self.drive.returned]])
        return [_drive(centre + root @ generator.standard_normal(len(centre))) for _ in range(count)]


def begin(arm: Arm, fixed: float) -> Drive:
    """Return the first guess of the drive, from the description alone."""
    n = arm.joints
    return Drive(fixed, np.ones(n), np.full(n, 0.7), np.full(n, 0.3), np.zeros(n), np.zeros(n), RETURNED[0])


def identify(observed: Sequence[Observed], drive: Drive, belief: Belief) -> Identified:
    """Fit the drive to all runs, weighting each run by how well the model explains it."""
    runs = list(observed)
    scatter = [1.0] * len(runs)
    covariance = np.zeros((0, 0))
    for _ in steps(range(ROUNDS), "round"):
        tables = [_equations(one, drive) for one in runs]
        found, covariance = _fitted(tables, scatter, drive, belief)
        shared = len(covariance)
        drive = _drive(found[:shared])
        own = found[shared:].reshape(len(runs), -1)
        scatter = [
            _weighed(table, np.concatenate([found[:shared], mine]), belief.noise, len(one.repetitions))
            for table, mine, one in zip(tables, own, runs, strict=True)
        ]
        runs = [replace(o, offset=refine(o.run.reading, o.modelled(drive), o.offset.seconds)) for o in runs]
    return Identified(drive, covariance, tuple(runs))


def _weighed(table: tuple[Float, Float], found: Float, noise: float, repetitions: int) -> float:
    """Error of one value, W: noise averages out over the values, the model's error less so."""
    design, value = table
    square = float(np.mean((value - design @ found) ** 2))
    missed = max(square - noise**2, 0.0) * NEIGHBOURS * repetitions
    return max(SHARPEST, float(np.sqrt(min(noise**2, square) + missed)))


def _equations(one: Observed, drive: Drive) -> tuple[Float, Float]:
    """Design (M, 2 + 5 n + 3) and measured power (M,) W: columns fixed, weights, returned, and the run's own terms.

    These are a shift of the clocks, s, additional power of the electronics, W, and of resistance, as a share.
    """
    n = len(drive.torque)
    bus = bus_power(drive, one.feature)
    share = np.where(bus > 0, 1.0, drive.returned)[:, None]
    columns = np.hstack([np.ones((len(bus), 1)), one.feature * share, np.minimum(bus, 0.0)[:, None]])
    design, supply, h = one.means(one.integral(columns)), one.modelled(drive), one.run.reading.step / 10
    slope = (one.means(supply, h) - one.means(supply, -h)) / (2 * h)
    warmer = design[:, 1 + n : 1 + 2 * n] @ drive.copper
    # Linearised at the present value of ``returned``; its column is the derivative of power.
    value = one.power + drive.returned * design[:, -1]
    return np.column_stack([design, slope, np.ones(len(slope)), warmer]), value


def _fitted(
    tables: Sequence[tuple[Float, Float]], scatter: Sequence[float], drive: Drive, belief: Belief
) -> tuple[Float, Float]:
    """Parameters of the drive followed by those of each run, and the covariance of the drive's."""
    shared, own = 2 + KINDS * len(drive.torque), len(OWN)
    size = shared + own * len(tables)
    products = Products(np.zeros((size, size)), np.zeros(size))
    for k, ((design, value), wide) in enumerate(zip(tables, scatter, strict=True)):
        at = np.concatenate([np.arange(shared), shared + own * k + np.arange(own)])
        products += Products.of(design, value, wide**2).placed(at, size)
    fit = Fit(products, Prior.joined(_prior(drive, belief), Prior.spread(np.tile(OWN, len(tables)))))
    lower, upper = np.full(size, -np.inf), np.full(size, np.inf)
    lower[:shared], upper[shared - 1] = 0.0, 1.0
    lower[1 : 1 + len(drive.torque)] = LEAST_TORQUE
    return fit.bounded(lower, upper), fit.covariance[:shared, :shared]


def _prior(drive: Drive, belief: Belief) -> Prior:
    """Prior of the drive: fixed power, torque, similarity of the joints, ``returned``."""
    n = len(drive.torque)
    parts = [Prior.spread(np.array([belief.fixed[1]]), belief.fixed[0])]
    parts.append(Prior.spread(belief.torque_uncertainty, belief.torque))
    for name, share in SPREAD.items():
        common = max(float(np.mean(getattr(drive, name))), 0.05)
        alike = (share * common) ** 2 * np.eye(n) + (FREE * common) ** 2
        parts.append(Prior(np.zeros(n), alike))
    return Prior.joined(*parts, Prior.spread(np.array([RETURNED[1]]), RETURNED[0]))


def _drive(vector: Float) -> Drive:
    torque, copper, switching, eddy, hysteresis = vector[1:-1].reshape(KINDS, -1)
    returned = float(np.clip(vector[-1], 0.0, 1.0))
    return Drive(float(vector[0]), torque, copper, switching, eddy, hysteresis, returned)
