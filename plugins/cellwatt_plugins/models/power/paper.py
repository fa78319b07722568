"""The paper's two estimators: nonlinear least squares for its physical model, and a network trained by SCG.

Development of Deep Learning for Power Energy Optimization in the Industrial Robot System: torque by equation (11),
current by (12), power by (13), Gauss–Newton by (10), the network by (6)–(9).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.perceptron import Perceptron
from cellwatt_plugins.models.power.shown import Shown, spacing
from cellwatt_plugins.models.power.tuning import Tuning
from cellwatt_plugins.robot import RigidBody, RobotDescription
from cellwatt_plugins.robot.law import column

Float = NDArray[np.float64]

NEURONS: Final = 8
ITERATIONS: Final = 400
ROWS: Final = 8000
"""That each is trained on."""
HELD: Final = 0.15
"""Share of the rows that tell SCG when to stop; whole moves."""
MOST: Final = 3.0
"""Bound of each friction number, as a multiple of the torque's size."""
OHM: Final = 20.0
"""Bound of a winding resistance."""
ALIKE: Final = 0.3
"""An input of a joint's network counts as spread by at least this share of what it is in the median joint."""
JOINT_NUMBERS: Final = ("k_m", "inertia", "viscous", "coulomb", "excess", "stribeck_velocity", "offset")
"""What NLS finds of each joint: Nm/A, kg m², Nm s/rad, Nm, Nm, rad/s, Nm."""
STRIBECK: Final = (0.01, 1.0)
"""rad/s: bounds of the Stribeck velocity."""


@dataclass(frozen=True)
class Seen:
    """What both estimators start from: N rows of smoothed motion and the torque that the URDF has for it."""

    q: Float
    qd: Float
    qdd: Float
    load: Float
    """(N, n) Nm."""
    sign: Float
    """tanh(q̇ / width)."""
    bounds: tuple[tuple[int, int], ...]
    """First and last row of the moves."""
    step: float
    constant: Float
    """(n,) Nm/A, as stated."""

    @classmethod
    def of(cls, moves: Moves, robot: RobotDescription, body: RigidBody, tuning: Tuning) -> Seen:
        """All rows."""
        q, qd, qdd = tuning.smoother.apply(moves)
        load = body.inverse_dynamics(q, qd, qdd)
        constant = column(robot, "torque_constant")
        return cls(q, qd, qdd, load, np.tanh(qd / tuning.width), tuple(moves.bounds()), moves.step, constant)

    def rate(self, values: Float) -> Float:
        """Derivative by time of columns (N, n), move by move."""
        out = np.zeros_like(values)
        for a, b in self.bounds:
            if b - a > 2:
                out[a:b] = np.gradient(values[a:b], self.step, axis=0)
        return out


@dataclass(frozen=True)
class Nls:
    """Fitted by nonlinear least squares."""

    joints: Float
    """(n, 7): see ``JOINT_NUMBERS``."""
    power: Float
    """(1 + 3 n,): P_c (with all k_d, which are constants too) W, then L, R, k_m of every joint."""
    errors: tuple[Float, Float]
    """Standard errors of both."""

    @classmethod
    def fit(cls, moves: Moves, seen: Seen, robot: RobotDescription) -> Nls:
        """Currents first, joint by joint, then power from the currents that were fitted."""
        kept = np.arange(0, len(moves), max(1, len(moves) // ROWS))
        fitted = [_joint(j, moves.current[kept, j], seen, kept, robot) for j in range(moves.joints)]
        joints = np.array([values for values, _ in fitted])
        columns = _power_columns(_currents(joints, seen), seen)
        every = spacing(moves, ROWS, len(moves))
        shown = Shown.of(moves, np.arange(0, len(moves), every))
        if not len(shown.power):
            size = columns.shape[1]
            return cls(joints, np.full(size, np.nan), (np.array([e for _, e in fitted]), np.full(size, np.nan)))
        n = moves.joints
        stated = column(robot, "winding_resistance")
        constants = column(robot, "torque_constant")
        start = np.concatenate([[np.median(shown.power)], np.zeros(n), stated, constants])
        low = np.concatenate([[0.0], np.full(n, -1.0), np.zeros(n), 0.3 * constants])
        high = np.concatenate([[np.inf], np.full(n, 1.0), np.full(n, OHM), 3 * constants])
        known = shown.seen(columns[::every])
        values, errors = _solved(lambda x: known @ x - shown.power, lambda x: known, start, low, high)
        return cls(joints, values, (np.array([e for _, e in fitted]), errors))

    def predict(self, seen: Seen) -> tuple[Float, Float]:
        """Power (N,) W and currents (N, n) A."""
        current = _currents(self.joints, seen)
        return _power_columns(current, seen) @ self.power, current


def _currents(joints: Float, seen: Seen) -> Float:
    return np.column_stack([_current(joints[j], j, seen, slice(None)) for j in range(len(joints))])


def _current(x: Float, j: int, seen: Seen, rows: NDArray[np.intp] | slice) -> Float:
    """Equations (11) and (12) with Stribeck friction."""
    constant, inertia, viscous, coulomb, excess, speed, offset = x
    qd, qdd, sign = seen.qd[rows, j], seen.qdd[rows, j], seen.sign[rows, j]
    friction = (coulomb + excess * np.exp(-((qd / speed) ** 2))) * sign + viscous * qd + offset
    return np.asarray((seen.load[rows, j] + inertia * qdd + friction) / constant)


def _joint(j: int, current: Float, seen: Seen, rows: NDArray[np.intp], robot: RobotDescription) -> tuple[Float, Float]:
    known = np.isfinite(current)
    if not known.any():
        return np.full(7, np.nan), np.full(7, np.nan)
    constant = robot.joints[j].torque_constant
    size = constant * float(np.std(current[known])) + 1e-6
    most, rotor = MOST * size, robot.joints[j].rotor_inertia
    start = np.array([constant, rotor, 0.1 * size, 0.3 * size, 0.05 * size, 0.1, 0.0])
    low = np.array([0.5 * constant, 0.0, 0.0, 0.0, -most, STRIBECK[0], -most])
    high = np.array([2 * constant, 3 * rotor + size, most, most, most, STRIBECK[1], most])
    rows = rows[known]
    return _solved(lambda x: _current(x, j, seen, rows) - current[known], "2-point", start, low, high)


def _power_columns(current: Float, seen: Seen) -> Float:
    """Equation (13): 1, i di/dt, i², q̇ i; (N, 1 + 3 n)."""
    ones = np.ones((len(current), 1))
    return np.concatenate([ones, current * seen.rate(current), current**2, seen.qd * current], axis=1)


def _solved(
    function: Callable[[Float], Float], jacobian: Any, start: Float, low: Float, high: Float
) -> tuple[Float, Float]:
    """Bounded least squares by trust-region Gauss–Newton; values and standard errors."""
    inside = np.clip(start, low + 1e-9, np.where(np.isfinite(high), high - 1e-9, start + 1))
    found = least_squares(function, inside, jacobian, (low, high), x_scale="jac", max_nfev=100)
    variance = 2 * found.cost / max(1, len(found.fun) - len(start))
    slopes = np.asarray(found.jac, np.float64)
    return found.x, np.sqrt(np.diag(np.linalg.pinv(slopes.T @ slopes)) * variance)


@dataclass(frozen=True)
class Scg:
    """A network a joint, from its motion and load to its current, and one from equation (13)'s terms to power."""

    currents: tuple[Perceptron, ...]
    supply: Perceptron | None

    @classmethod
    def fit(cls, moves: Moves, seen: Seen, seed: int) -> Scg:
        """Every seventh move or so tells when to stop."""
        every = max(2, round(1 / HELD))

        def train(x: Float, y: Float, least: Float) -> Perceptron:
            kept = np.flatnonzero(np.isfinite(y).all(axis=1))
            kept = kept[:: max(1, len(kept) // ROWS)]
            held = moves.move[kept] % every == every - 1 if moves.count >= every else np.zeros(len(kept), bool)
            return Perceptron.train(x[kept], y[kept], held, NEURONS, ITERATIONS, seed, least)

        inputs = [_joint_inputs(seen, j) for j in range(moves.joints)]
        least = ALIKE * np.median([each.std(axis=0) for each in inputs], axis=0)
        currents = tuple(train(each, moves.current[:, [j]], least) for j, each in enumerate(inputs))
        if not np.isfinite(moves.power).any():
            return cls(currents, None)
        terms = _supply_inputs(cls(currents, None)._currents(seen), seen)
        groups = terms.std(axis=0).reshape(-1, moves.joints + 1)
        least = ALIKE * np.repeat(np.median(groups, axis=1), moves.joints + 1)
        if moves.meter is None:
            return cls(currents, train(terms, moves.power[:, None], least))
        shown = Shown.of(moves, np.arange(len(moves)))
        held = moves.move[shown.at] % every == every - 1
        inputs_shown = shown.seen(terms)
        return cls(
            currents, Perceptron.train(inputs_shown, shown.power[:, None], held, NEURONS, ITERATIONS, seed, least)
        )

    def predict(self, seen: Seen) -> tuple[Float, Float]:
        """Power (N,) W and currents (N, n) A."""
        current = self._currents(seen)
        if self.supply is None:
            return np.full(len(current), np.nan), current
        return self.supply(_supply_inputs(current, seen))[:, 0], current

    def _currents(self, seen: Seen) -> Float:
        return np.concatenate([network(_joint_inputs(seen, j)) for j, network in enumerate(self.currents)], axis=1)


def _joint_inputs(seen: Seen, j: int) -> Float:
    return np.column_stack([seen.load[:, j], seen.qd[:, j], seen.qdd[:, j], seen.sign[:, j]])


def _supply_inputs(current: Float, seen: Seen) -> Float:
    """Copper and mechanical terms of equation (13) by joint and in sum, the latter also without their sign.

    What a drive gives back is not worth what it takes: with |x| beside x both have a weight of their own.
    """
    terms = [current**2, seen.constant * seen.qd * current]
    terms = [np.concatenate([each, each.sum(axis=1, keepdims=True)], axis=1) for each in terms]
    return np.concatenate([*terms, np.abs(terms[1])], axis=1)
