"""Cycles with and without faults, as the fitted arm would run them: what the network is trained on.

Each is the task's healthy pattern, what may differ harmlessly, the meter's noise, and at most two faults, whose power
is reckoned with the arm's equations: drives' torque times speed and copper loss, through the supply (``cycles.arm``).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from cellwatt.progress import steps
from cellwatt_plugins.faults.ann.bins import PARTS, Bins, together
from cellwatt_plugins.faults.cycles.arm import Motion, Parameters, torque
from cellwatt_plugins.faults.cycles.effects import part_effects, warm_up
from cellwatt_plugins.faults.cycles.explain import WARM
from cellwatt_plugins.faults.cycles.identify import LEAST, FittedArm
from cellwatt_plugins.faults.cycles.load import Load, load_of, motor_alone
from cellwatt_plugins.faults.cycles.pattern import Pattern
from cellwatt_plugins.faults.cycles.samples import LEVEL, SHARE, SHIFT, inside_moves
from cellwatt_plugins.robot.drive import drive_power
from cellwatt_plugins.robot.motion import direction

Float = NDArray[np.float64]
Flags = NDArray[np.bool_]

ARMS = 10
"""Arms that are drawn: parameters as likely as the healthy power leaves them."""
PACES = 0.05
"""Share of the speed over which power's slope with the pace is read."""
PACE, UNEVEN = 0.03, 0.004
"""Shares by which a cycle, and each move of it, may be faster or slower (one sigma)."""
OTHER_PART, OTHER_PACE = 0.3, 0.5
"""Shares of cycles with a part of another weight, and with another pace."""
LEAST_WAY = 0.05
"""rad; a joint that goes less far has no faults injected."""
HEALTHY, TWICE = 0.35, 0.3
"""Shares of cycles without a fault, and of faulty ones with two."""
EFFECT = 0.15
"""Share by which a fault may differ from what the equations say in each move (one sigma)."""
SIZES = {"spring": (0.8, 15.0), "friction": (0.25, 3.0), "winding": (0.2, 2.5)}
"""Smallest and largest: a spring over a radian in multiples of Coulomb friction, shares of friction and resistance."""
OFFSET, SCALE = (0.015, 0.25), (0.04, 0.4)
"""Smallest and largest: rad by which an encoder is off, and share of its way."""
LOADED = ("spring", "friction", "winding")
KINDS = (*LOADED, "drive_cut", "belt_off", "offset", "scale", "stuck")
ODDS = (0.2, 0.2, 0.2, 0.1, 0.1, 0.07, 0.07, 0.06)
"""Probability of drawing each of ``KINDS``."""
DEAD = ("drive_cut", "belt_off")
CREEPS = 0.1
"""Share of joints that stand still whose encoder is faulty, too: it shows a part of the way."""


@dataclass(frozen=True)
class Injected:
    """Inputs (N, inputs) of cycles, whose joints (N, n) and encoders (N, n) are faulty; the largest mean residual that
    a fault of power makes in a part of a move, ``watts`` (N,) W."""

    inputs: Float
    joints: Flags
    encoders: Flags
    watts: Float

    @property
    def labels(self) -> Float:
        """(N, 2 n + 1): joints, encoders, and whether any joint is faulty."""
        return np.column_stack([self.joints, self.encoders, self.joints.any(axis=1)]).astype(np.float64)


@dataclass(frozen=True)
class _Drawn:
    """An arm on the task's path: what its drives take from the supply (T,) W, and its harmless changes.

    ``driven`` are its torques and drives where some joints stand still.
    """

    parameters: Parameters
    supplied: Float
    harmless: Float
    """(power, h) W for one sigma each: level, friction, moves' shift, share and power left out."""
    parts: Float
    """(power, k) W of a part of another weight, held between two moves (one sigma)."""
    paces: Float
    """(power, moves) W for a move that is faster by the whole speed."""
    driven: dict[tuple[int, ...], tuple[Float, Float]] = field(default_factory=dict)


class Injector:
    """Draws cycles of one task on one arm; the same ``seed`` draws the same."""

    def __init__(self, arm: FittedArm, pattern: Pattern, seed: int) -> None:
        self._arm, self.bins = arm, Bins(pattern)
        self._random = np.random.default_rng(seed)
        self._motion = Motion(pattern.position, *pattern.rates)
        self._regressors: dict[tuple[int, ...], tuple[Motion, Float]] = {}
        self._means = self.bins.means(pattern.time, np.eye(len(pattern.time)))
        self._rests = (self._means @ pattern.position)[-self.bins.moves - 1 :]
        part = self.bins.part_of(pattern.time)
        counts = np.maximum(np.bincount(part[part >= 0], minlength=self.bins.power), 1)
        spread = self.bins.means(pattern.time, pattern.spread**2)
        self._noise = np.sqrt(np.maximum(spread, 1e-4) * (1 / counts + 1 / max(1, pattern.cycles)))

    def draw(self, count: int, healthy: float = HEALTHY) -> Injected:
        """``count`` cycles, of which the share ``healthy`` has no fault."""
        sizes = np.full(ARMS, count // ARMS) + (np.arange(ARMS) < count % ARMS)
        parts = [self._of_one_arm(self._arm_drawn(), int(size), healthy) for size in steps(sizes, "arm")]
        return Injected(
            *(np.concatenate([getattr(p, n) for p in parts]) for n in ("inputs", "joints", "encoders", "watts"))
        )

    def _of_one_arm(self, drawn: _Drawn, count: int, healthy: float) -> Injected:
        bins, random = self.bins, self._random
        power = random.standard_normal((count, bins.power)) * self._noise
        power += random.standard_normal((count, drawn.harmless.shape[1])) @ drawn.harmless.T
        chosen = drawn.parts[:, random.integers(drawn.parts.shape[1], size=count)].T
        power += chosen * (random.standard_normal(count) * (random.random(count) < OTHER_PART))[:, None]
        pace = np.repeat(
            random.normal(0.0, PACE, (count, 1)) * (random.random((count, 1)) < OTHER_PACE), bins.moves, axis=1
        )
        pace += random.normal(0.0, UNEVEN, pace.shape)
        power += pace @ drawn.paces.T
        joints, encoders = np.zeros((2, count, bins.joints), bool)
        rests = random.normal(0.0, 1e-4, (count, bins.moves + 1, bins.joints))
        watts = np.zeros(count)
        for i in np.flatnonzero(random.random(count) >= healthy).tolist():
            effect = self._faults(drawn, joints[i], encoders[i], rests[i])
            power[i] += effect
            watts[i] = np.abs(effect).max()
        return Injected(together(power, pace, rests), joints, encoders, watts)

    def _faults(self, drawn: _Drawn, joints: Flags, encoders: Flags, rests: Float) -> Float:
        """One fault or two, written into flags (n,) and rests (moves + 1, n); mean residuals (power,) W."""
        random, bins, p = self._random, self.bins, drawn.parameters
        moving = np.flatnonzero(np.ptp(self._motion.q, axis=0) > LEAST_WAY)
        number = min(len(moving), 2 if random.random() < TWICE else 1)
        chosen = sorted(random.choice(moving, number, replace=False).tolist())
        kinds = {j: str(random.choice(KINDS, p=ODDS)) for j in chosen}
        for j, kind in kinds.items():
            creeps = kind in DEAD and random.random() < CREEPS
            joints[j] = kind in LOADED or kind in DEAD
            encoders[j] = creeps or not joints[j]
            rests[:, j] += self._shown(kind, j) * (random.uniform(0.1, 0.9) if creeps else 1.0)
        if not joints.any():
            return np.zeros(bins.power)
        motion, forces, drives = self._driven(drawn, tuple(j for j in chosen if kinds[j] in DEAD))
        for j, kind in kinds.items():
            if kind in DEAD:
                drives[:, j] = self._alone(p, j) if kind == "belt_off" else 0.0
            elif kind in LOADED:
                drives[:, j] += self._loaded(p, kind, j, forces[:, j], motion.qd[:, j])
        effect = self._means @ (_supplied(p, drives.sum(axis=1)) - drawn.supplied)
        scale = np.exp(random.normal(0.0, EFFECT, bins.moves + 1))
        return np.asarray(effect * scale[_move_of(bins)])

    def _loaded(self, p: Parameters, kind: str, j: int, force: Float, qd: Float) -> Float:
        """Power (T,) W that the drive of a joint under a load takes more."""
        size = _log_uniform(self._random, *SIZES[kind])
        if kind == "winding":
            return np.asarray(size * p.copper[j] * force**2)
        rubbing = p.coulomb[j] * direction(qd) + p.viscous[j] * qd
        extra = size * (rubbing if kind == "friction" else max(float(p.coulomb[j]), 1e-3) * self._pull(j))
        return np.asarray(qd * extra + p.copper[j] * (2 * force * extra + extra**2))

    def _alone(self, p: Parameters, j: int) -> Float:
        """Power (T,) W of a motor whose belt is off: shares of its friction and rotor that no description gives."""
        rubbing, turning = motor_alone(p, self._motion, j)
        return np.asarray(self._random.uniform(0.2, 0.8) * rubbing + self._random.uniform(0.2, 1.0) * turning)

    def _driven(self, drawn: _Drawn, still: tuple[int, ...]) -> tuple[Motion, Float, Float]:
        """The motion where some joints stay where it begins, and torques (T, n) Nm and drives (T, n) W of an arm."""
        if still not in self._regressors:
            q, qd, qdd = (each.copy() for each in (self._motion.q, self._motion.qd, self._motion.qdd))
            for j in still:
                q[:, j], qd[:, j], qdd[:, j] = q[0, j], 0.0, 0.0
            self._regressors[still] = Motion(q, qd, qdd), self._arm.body.regressor(q, qd, qdd)
        motion, regressor = self._regressors[still]
        if still not in drawn.driven:
            forces = torque(drawn.parameters, regressor, motion)
            drawn.driven[still] = forces, drive_power(drawn.parameters.copper, forces, motion.qd)
        forces, drives = drawn.driven[still]
        return motion, forces, drives.copy()

    def _pull(self, j: int) -> Float:
        """rad (T,) by which a spring on a joint is stretched: on both sides of where it is slack, or on one."""
        q = self._motion.q[:, j]
        way = q - np.quantile(q, self._random.random())
        side = self._random.random()
        return np.asarray(way if side < 0.6 else np.maximum(way, 0.0) if side < 0.8 else np.minimum(way, 0.0))

    def _shown(self, kind: str, j: int) -> Float:
        """rad (moves + 1,) by which an encoder is off in each rest."""
        random, bins = self._random, self.bins
        rest = self._rests[:, j]
        sign = random.choice([-1.0, 1.0])
        if kind in DEAD:
            return np.asarray(rest[0] - rest)
        if kind == "offset":
            return np.full(bins.moves + 1, sign * _log_uniform(random, *OFFSET))
        if kind == "scale":
            return np.asarray(sign * _log_uniform(random, *SCALE) * (rest - rest[0]))
        if kind == "stuck":
            since = int(random.integers(0, bins.moves))
            share = random.random()
            at = rest[since] + share * (rest[since + 1] - rest[since])
            return np.where(np.arange(bins.moves + 1) > since, at - rest, 0.0)
        return np.zeros(bins.moves + 1)

    def _arm_drawn(self) -> _Drawn:
        """An arm as likely as the healthy power leaves it, on the task's path."""
        p, pattern = self._parameters(), self.bins.pattern
        load = load_of(self._arm.body, p, self._motion)
        level = float(np.median(pattern.power[~inside_moves(pattern, pattern.time, 0.0)]))
        columns = [np.full(len(pattern.time), LEVEL), WARM * warm_up(p, load)]
        for start, end in pattern.moves:
            here = (pattern.time >= start) & (pattern.time <= end)
            columns.append(np.where(here, pattern.slope * SHIFT, 0.0))
            columns.append(np.where(here, (pattern.power - level) * SHARE, 0.0))
        harmless = self.bins.means(pattern.time, np.column_stack(columns))
        return _Drawn(p, _supplied(p, load.drives.sum(axis=1)), harmless, self._held(p, load), self._slopes(p))

    def _parameters(self) -> Parameters:
        p = self._arm.parameters.packed()
        drawn = p + self._arm.deviations @ self._random.standard_normal(len(p))
        return Parameters.unpacked(np.where((p > 0) & (drawn < LEAST * p), LEAST * p, drawn), self.bins.joints)

    def _held(self, p: Parameters, load: Load) -> Float:
        """(power, k) W of a part of another weight."""
        pattern = self.bins.pattern
        starts = [start for start, _ in pattern.moves] + [pattern.moves[-1][1]]
        inside = np.column_stack([(pattern.time >= start).astype(np.float64) for start in starts])
        columns = [effect.columns[:, 0] for effect in part_effects(replace(self._arm, parameters=p), load, inside)]
        return self.bins.means(pattern.time, np.column_stack(columns))

    def _slopes(self, p: Parameters) -> Float:
        """(power, moves) W of each move, for a pace that is higher by the whole speed."""
        faster, slower = (
            load_of(self._arm.body, p, Motion(m.q, m.qd * s, m.qdd * s**2)).power
            for m, s in ((self._motion, 1 + PACES), (self._motion, 1 - PACES))
        )
        slope = self.bins.means(self.bins.pattern.time, (faster - slower) / (2 * PACES))
        return np.asarray(slope[:, None] * (_move_of(self.bins)[:, None] == np.arange(self.bins.moves)))


def _move_of(bins: Bins) -> NDArray[np.int64]:
    """The move (power,) that each input of power is part of; the number of moves for rests."""
    whole = np.repeat(np.arange(bins.moves), PARTS)
    return np.concatenate([whole, np.full(bins.moves + 1, bins.moves)])


def _supplied(p: Parameters, total: Float) -> Float:
    """Power (T,) W at the supply, without its standing power, of what drives take together."""
    return np.where(total > 0, p.drive, p.regenerate) * total


def _log_uniform(random: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(random.uniform(np.log(low), np.log(high))))
