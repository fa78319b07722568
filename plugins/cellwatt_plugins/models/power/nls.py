"""The paper's physical model, fitted by nonlinear least squares: its equations (10) to (14).

Torque by (11) with Stribeck friction, current by (12), power by (13); (10) is solved by Gauss–Newton in a trust region.
The torque constant k_m is one number in (12) and (13), as printed. Inductances, resistances and friction are limited to
what a motor can have; where the data exceed a limit, the number compensates for effects that the equations lack, and
``doubts`` says so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cellwatt.arrays import Float
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.paper import ROWS, Seen, Traced
from cellwatt_plugins.models.power.shown import Shown, spacing
from cellwatt_plugins.models.power.terms import Motion
from cellwatt_plugins.robot import RobotDescription

JOINT_NUMBERS: Final = ("k_m", "inertia", "viscous", "coulomb", "excess", "stribeck_velocity", "offset")
"""Numbers of each joint, in Nm/A, kg m², Nm s/rad, Nm, Nm, rad/s, Nm."""
NUMBERS: Final = (*JOINT_NUMBERS, "inductance", "resistance")
MOST: Final = 3.0
"""Bound of each friction number, as a multiple of the torque's size."""
STRIBECK: Final = (0.01, 1.0)
"""Bounds of the Stribeck velocity, rad/s."""
HENRY: Final = 0.1
"""Upper bound of a winding's inductance, H."""
OHM: Final = (1e-3, 20.0)
"""Bounds of a winding's resistance, Ω, if none is stated; else half and twice the stated one."""
APART: Final = 0.1
"""Largest relative difference between the k_m of power alone and that of the currents."""
AT_BOUND: Final = 1e-3
"""Share of the distance between its bounds within which a number is at a bound."""


@dataclass(frozen=True)
class Nls:
    """The fitted model of n joints."""

    joints: Float
    """(n, 7): see ``JOINT_NUMBERS``."""
    power: Float
    """(1 + 2 n,): P_c (with all k_d, which are also constants) in W, then L in H, then R in Ω of every joint."""
    errors: tuple[Float, Float]
    """Standard errors of ``joints`` and ``power``."""
    doubts: tuple[str, ...]
    """Numbers that compensate for effects the equations lack, one line each."""

    @classmethod
    def fit(cls, moves: Moves, seen: Seen, robot: RobotDescription) -> Nls:
        """Fit the currents joint by joint; then power, with the currents' k_m as prior; then currents with the new
        k_m."""
        sampled = np.arange(0, len(moves), max(1, len(moves) // ROWS))
        alone = [_joint(moves.current, seen.motion, sampled, robot, j) for j in range(moves.joints)]
        joints, errors = (np.array(each) for each in zip(*alone, strict=True))
        every = spacing(moves, ROWS, len(moves))
        shown = Shown.of(moves, np.arange(0, len(moves), every))
        n = moves.joints
        if not len(shown.power):
            unknown = np.full(1 + 2 * n, np.nan)
            doubts = _doubts(joints, unknown, np.full(1 + 3 * n, np.nan), joints[:, 0], robot, moves)
            return cls(joints, unknown, (errors, unknown), doubts)
        known = shown.seen(_columns(_current(joints, seen.motion), seen)[::every])
        low, high = _bounds(robot)
        free, _ = _solved(lambda x: known @ x - shown.power, lambda x: known, _start(shown, robot), low, high)
        noise = float(np.std(known @ free - shown.power)) + 1e-9
        believed = np.where(np.isfinite(errors[:, 0]), np.maximum(errors[:, 0], 1e-9), np.inf)
        rows = np.concatenate([known / noise, np.eye(1 + 3 * n)[1 + 2 * n :] / believed[:, None]])
        target = np.concatenate([shown.power / noise, np.nan_to_num(joints[:, 0]) / believed])
        power, spread = _solved(lambda x: rows @ x - target, lambda x: rows, _start(shown, robot), low, high)
        constants = power[1 + 2 * n :]
        again = [_joint(moves.current, seen.motion, sampled, robot, j, constants[j]) for j in range(n)]
        values, deviations = (np.array(each) for each in zip(*again, strict=True))
        deviations[:, 0] = spread[1 + 2 * n :]
        doubts = _doubts(values, power, free, joints[:, 0], robot, moves)
        return cls(values, power[: 1 + 2 * n], (deviations, spread[: 1 + 2 * n]), doubts)

    def predict(self, seen: Seen | Traced) -> Any:
        """Power (N,) W and currents (N, n) A of seen moves; of a traced motion, the model file that gives them."""
        current = _current(self.joints, seen.motion)
        here: Any = seen.here(current)
        known = np.isfinite(self.power).all()
        power = self._supply(here, seen.rate(current), seen.here(seen.motion.qd)) if known else None
        return seen.given(power, here)

    def _supply(self, current: Any, rate: Any, qd: Any) -> Any:
        """Equation (13): (N, 1) W from current A, its rate A/s and velocity rad/s of every joint."""
        inductance, resistance = self.power[1:].reshape(2, -1)
        drawn = current * (rate * inductance + current * resistance + qd * self.joints[:, 0])
        return drawn.sum(axis=-1, keepdims=True) + self.power[0]


def _current(joints: Float, m: Motion) -> Any:
    """Equations (11) and (12): currents in A for the joints' numbers (n, 7)."""
    constant, inertia, viscous, coulomb, excess, speed, offset = joints.T
    slowness = m.qd * (1 / speed)
    friction = (coulomb + excess * np.exp(-(slowness * slowness))) * m.sign + viscous * m.qd + offset
    return (m.load + inertia * m.qdd + friction) * (1 / constant)


def _joint(
    current: Float, m: Motion, rows: NDArray[np.intp], robot: RobotDescription, j: int, constant: float | None = None
) -> tuple[Float, Float]:
    """The numbers (7,) of one joint, from some rows, and their standard errors; with a ``constant``, k_m is fixed."""
    rows = rows[np.isfinite(current[rows, j])]
    if not len(rows):
        return np.full(7, np.nan), np.full(7, np.nan)
    measured = current[rows, j]
    start, low, high = _joint_bounds(robot, j, float(np.std(measured)))
    motion = Motion(*(each[rows, j] for each in (m.q, m.qd, m.qdd, m.load, m.sign)))

    def residual(x: Float) -> Float:
        given = x if constant is None else np.concatenate([[constant], x])
        return np.asarray(_current(given, motion) - measured)

    if constant is None:
        return _solved(residual, "2-point", start, low, high)
    values, errors = _solved(residual, "2-point", start[1:], low[1:], high[1:])
    return np.concatenate([[constant], values]), np.concatenate([[np.nan], errors])


def _joint_bounds(robot: RobotDescription, j: int, spread: float) -> tuple[Float, Float, Float]:
    """Return start and bounds of the numbers of a joint whose current varies by ``spread`` A."""
    constant, rotor = robot.joints[j].torque_constant, robot.joints[j].rotor_inertia
    size = constant * spread + 1e-6
    most = MOST * size
    start = np.array([constant, rotor, 0.1 * size, 0.3 * size, 0.05 * size, 0.1, 0.0])
    low = np.array([0.5 * constant, 0.0, 0.0, 0.0, -most, STRIBECK[0], -most])
    high = np.array([2 * constant, 3 * rotor + size, most, most, most, STRIBECK[1], most])
    return start, low, high


def _columns(current: Float, seen: Seen) -> Float:
    """Columns of equation (13): 1, i di/dt, i², q̇ i; (N, 1 + 3 n)."""
    ones = np.ones((len(current), 1))
    return np.concatenate([ones, current * seen.rate(current), current**2, seen.motion.qd * current], axis=1)


def _start(shown: Shown, robot: RobotDescription) -> Float:
    resistance = robot.column("winding_resistance")
    median = [float(np.median(shown.power))]
    return np.concatenate([median, 0 * resistance, resistance, robot.column("torque_constant")])


def _bounds(robot: RobotDescription) -> tuple[Float, Float]:
    """Bounds of P_c, L, R, k_m."""
    constant, resistance = robot.column("torque_constant"), robot.column("winding_resistance")
    stated = resistance > 0
    low = [np.zeros(1), 0 * constant, np.where(stated, 0.5 * resistance, OHM[0]), 0.5 * constant]
    high = [np.full(1, np.inf), np.full_like(constant, HENRY), np.where(stated, 2 * resistance, OHM[1]), 2 * constant]
    return np.concatenate(low), np.concatenate(high)


def _solved(
    function: Callable[[Float], Float], jacobian: Any, start: Float, low: Float, high: Float
) -> tuple[Float, Float]:
    """Bounded least squares by trust-region Gauss–Newton; values and standard errors."""
    inside = np.clip(start, low + 1e-9, np.where(np.isfinite(high), high - 1e-9, start + 1))
    found = least_squares(function, inside, jacobian, (low, high), x_scale="jac", max_nfev=100)
    variance = 2 * found.cost / max(1, len(found.fun) - len(start))
    slopes = np.asarray(found.jac, np.float64)
    return found.x, np.sqrt(np.diag(np.linalg.pinv(slopes.T @ slopes)) * variance)


def _doubts(
    joints: Float, power: Float, free: Float, by_current: Float, robot: RobotDescription, moves: Moves
) -> tuple[str, ...]:
    """Numbers at a bound that no motor or gear would have, and each k_m that differs from that of power alone."""
    n, (least, most) = len(joints), _bounds(robot)
    found = []
    for j in np.flatnonzero(np.isfinite(joints).all(axis=1)).tolist():
        _, low, high = _joint_bounds(robot, j, float(np.nanstd(moves.current[:, j])))
        windings = [1 + j, 1 + n + j]
        low, high = np.append(low, least[windings]), np.append(high, most[windings])
        values, near = np.append(joints[j], power[windings]), AT_BOUND * (high - low)
        at_bound = [
            f"{name} ({value:.3g})"
            for name, value, at in zip(NUMBERS, values, (values - low < near) | (high - values < near), strict=True)
            if at and name not in ("k_m", "stribeck_velocity")
        ]
        if at_bound:
            found.append(
                f"{robot.joints[j].name}: {', '.join(at_bound)}: at a bound, it compensates for what the equations lack"
            )
        wanted = free[1 + 2 * n + j]
        if abs(wanted / by_current[j] - 1) > APART:
            found.append(
                f"k_m of joint {j + 1}: {by_current[j]:.3g} Nm/A from currents, {wanted:.3g} from power: masses of "
                "the URDF are wrong, or the supply has a loss that equation (13) lacks"
            )
    return tuple(found)
