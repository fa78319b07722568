"""The torque of every joint as columns times unknown coefficients, and the prior of these coefficients."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float, rows_of
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.shown import Shown, spacing
from cellwatt_plugins.models.power.smoothing import Smoother
from cellwatt_plugins.models.power.terms import EFFECTS, LAWS, TORQUE, WARM, Motion
from cellwatt_plugins.robot import Arm, Body
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.priors import links_prior
from cellwatt_plugins.robot.regression import Prior

CARRIED: Final = 4
"""Number of parameters of the load, per kg of the stated payload: its mass and m·c at the last joint's frame."""
CARRIED_AS_STATED: Final = np.array([1.0, 0.0, 0.0, 0.0])
"""The load's parameters as stated: a point mass at the last joint's frame."""
REACH: Final = 0.1
"""Standard deviation in m of a payload's centre of mass from the last joint's frame."""
SHARES: Final = {"gain": 0.1, "friction by load": 0.1, "viscous load": 0.1}
"""Prior standard deviations of terms that are shares of the load."""
PER_WARMTH: Final = 10.0
"""K of joint temperature per unit of warmth."""


@dataclass(frozen=True)
class Rows:
    """N rows of smoothed motion with the measured torque and power; n joints."""

    q: Float
    qd: Float
    qdd: Float
    """(N, n) each."""
    torque: Float
    """(N, n) Nm: current times stated torque constant; NaN where not measured."""
    at: NDArray[np.intp]
    """(N,) their indices among the rows of the moves."""
    payload: Float | None
    """(N,) kg."""
    warmth: Float | None
    """(N, n): joint temperature minus its mean, in ``PER_WARMTH``."""
    shown: Shown
    """Measured power of these rows."""

    def __len__(self) -> int:
        return len(self.q)

    @classmethod
    def of(cls, moves: Moves, smoother: Smoother, constant: Float, most: int, whole: bool = True) -> Rows:
        """At most ``most`` rows, evenly spread; if ``whole``, only rows with a complete window."""
        q, qd, qdd = smoother.apply(moves)
        chosen = np.flatnonzero(smoother.whole(moves) if whole else np.ones(len(moves), bool))
        if not len(chosen):
            chosen = np.arange(len(moves))
        chosen = chosen[:: spacing(moves, most, len(chosen))]
        torque = moves.current * constant
        every = np.arange(len(moves))
        rows = rows_of(cls(q, qd, qdd, torque, every, moves.payload, None, Shown.of(moves, chosen)), chosen)
        if moves.temperature is None:
            return rows
        return rows.with_temperature(moves.temperature[chosen], np.nanmean(moves.temperature, axis=0))

    def with_temperature(self, temperature: Float, mean: Float) -> Rows:
        """Add the warmth: joint temperatures (N, n) minus a training's mean (n,), °C."""
        return replace(self, warmth=(temperature - mean) / PER_WARMTH)


def spread_of(values: Float) -> Float:
    """Standard deviation (n,) of each joint's values (N, n); the median of the others for a joint without any."""
    known = np.isfinite(values).any(axis=0)
    spread = np.nanstd(values[:, known], axis=0)
    out = np.full(values.shape[1], np.median(spread))
    out[known] = spread
    return out


@dataclass(frozen=True)
class Design:
    """Columns of the torque: columns shared by all joints, and each joint's own."""

    shared: Float
    """(N, n, R): inertial parameters of all links, then those of the load if a payload was recorded."""
    own: Float
    """(N, n, F): one column per term."""
    names: tuple[str, ...]
    """Names of the F terms."""
    width: float
    """rad/s within which friction reverses."""

    @classmethod
    def of(cls, rows: Rows, shared: Float, inertial: Float, width: float, names: Sequence[str]) -> Design:
        """The columns of all ``names`` beside the ``shared`` ones; ``inertial`` (R,) gives the load that some depend
        on."""
        motion = Motion(rows.q, rows.qd, rows.qdd, shared @ inertial, np.tanh(rows.qd / width), rows.warmth)
        return cls(shared, np.stack([TORQUE[name](motion) for name in names], axis=2), tuple(names), width)

    @classmethod
    def stated(cls, rows: Rows, body: Body, width: float, names: Sequence[str]) -> tuple[Design, Float]:
        """The same with the load of the URDF and of the payload as stated; and the load's parameters, (R,)."""
        links, carrying = body.parameters(), rows.payload is not None
        inertial = np.concatenate([links, CARRIED_AS_STATED]) if carrying else links
        return cls.of(rows, shared_columns(rows, body, carrying), inertial, width, names), inertial


@dataclass(frozen=True)
class Belief:
    """Prior of the coefficients."""

    shared: Prior
    """Prior of the R coefficients that all joints share."""
    own: Float
    own_spread: Float
    """(F, n): mean and standard deviation of each joint's own coefficients."""

    @classmethod
    def of(cls, arm: Arm, design: Design, scale: Float, doubt: float) -> Belief:
        """Return the description's prior; ``scale`` (n,) Nm: size of the torques, ``doubt``: factor on links'
        tolerances."""
        links = arm.body.parameters()
        shared = Prior(links, links_prior(links, doubt * arm.description.tolerances.link).covariance)
        if design.shared.shape[2] > len(links):
            shared = Prior.joined(shared, Prior.spread(np.array([0.02, REACH, REACH, REACH]), CARRIED_AS_STATED))
        size = np.sqrt(np.mean(design.own**2, axis=0)).T
        # A joint that hardly moves is as likely as the others to have friction.
        size = np.maximum(size, 0.5 * size.max(axis=1, keepdims=True))
        own, own_spread = np.zeros_like(size), scale / np.maximum(size, 1e-9)
        for name in SHARES.keys() & set(design.names):
            own_spread[design.names.index(name)] = SHARES[name]
        stated = {"rotor": "rotor_inertia", "coulomb": "coulomb_friction", "viscous": "viscous_friction"}
        for name, key in stated.items():
            own[design.names.index(name)] = arm.column(key)
        row, known = design.names.index("rotor"), arm.column("rotor_inertia")
        own_spread[row] = np.where(known > 0, arm.description.tolerances.rotor_inertia * known, own_spread[row])
        return cls(shared, own, own_spread)


def shared_columns(rows: Rows, body: Body, carrying: bool) -> Float:
    """(N, n, 10 n): torque for 1 of each inertial parameter; with 4 more of the load if the arm is ``carrying``."""
    columns = body.regressor(rows.q, rows.qd, rows.qdd)
    if not carrying or rows.payload is None:
        return columns
    carried = columns[:, :, -PER_LINK : CARRIED - PER_LINK] * rows.payload[:, None, None]
    return np.concatenate([columns, carried], axis=2)


def possible(rows: Rows, width: float) -> tuple[str, ...]:
    """The effects that these rows can show."""
    fastest = float(np.quantile(np.abs(rows.qd), 0.99))
    hidden = {words for words, (law, shape) in LAWS.items() if not law.shown(shape, 2 * width, fastest)}
    return tuple(e for e in EFFECTS if e not in hidden and (e != WARM or rows.warmth is not None))
