"""Coupled joints: a motor that also turns while another joint moves, as in many wrists and parallelograms.

The friction and the rotor of such a motor follow its own speed, that of its joint and a multiple of another one's, and
load both joints. A structure is accepted if it predicts the torques of both joints clearly better on data left out
than separate motors do; a multiple other than 1 if it does so clearly better than 1.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.leave_out import Folds, compared
from cellwatt_plugins.robot.blocks import Block, Design
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import direction
from cellwatt_plugins.robot.priors import links_prior
from cellwatt_plugins.robot.regression import Prior

ROWS = 3000
"""Approximate number of samples that are compared."""
FEWEST = 200
"""Smallest number of samples with the torques of both joints."""
FOLDS = 10
APART = 2
"""Largest difference of the numbers of two joints that may be coupled."""
SLOWEST = 0.01
"""Standard deviation of a speed in rad/s from which a joint moves."""
BENDS = 0.1
"""Speed in rad/s about which friction may bend."""
LINKS = 0.3
"""Tolerance of the links' parameters: a description may be that far off."""
ALIKE = 10.0
"""Samples of one motion are far from independent: so many count as one."""
SHARE, EACH = 0.25, 0.1
"""Share of the mean square error on data left out that a coupling must remove: the mean of both joints, and each."""
SURE = 4.0
"""Standard errors of the removed share."""
SEPARATE = (1, 0), (0, 1)
DIFFERENTIAL = (1, 1), (-1, 1)
RATIOS = (1 / 3, 0.6, 1.0, 5 / 3, 3.0)
"""Turns of a motor per turn of the other joint that are tried, either way."""
FINER = 1.3, 1.06, 1.012
"""Steps between the ratios that are tried next, three either way of the best."""

Turns = tuple[tuple[float, float], tuple[float, float]]
"""Turns of both motors, a pair each, per turn of each joint."""


@dataclass(frozen=True)
class Coupling:
    """Two coupled joints."""

    joints: tuple[int, int]
    """0-based."""
    turns: Turns
    before: Float
    """Rms error (2,) Nm of both joints on data left out, with separate motors."""
    after: Float
    """The same with coupled motors."""


def couplings(states: Sequence[States], residuals: Sequence[Float]) -> list[Coupling]:
    """Coupled joints of an arm, each in one pair; ``residuals`` (N, n) Nm of each run are torque beyond the nominal."""
    thin = max(1, sum(len(s.time) for s in states) // ROWS)
    residual = np.concatenate([part[::thin] for part in residuals])
    speed, gain = (np.concatenate([getattr(s, name)[::thin] for s in states]) for name in ("qd", "qdd"))
    moving = np.flatnonzero((np.std(speed, axis=0) > SLOWEST) & np.isfinite(residual).any(axis=0)).tolist()
    body = states[0].arm.body
    found: list[tuple[float, Coupling]] = []
    for a, b in combinations(moving, 2):
        pair, links = [a, b], slice(PER_LINK * a, None)
        known = np.isfinite(residual[:, pair]).all(axis=1)
        if b - a > APART or body.turns[a] != body.turns[b] or known.sum() < FEWEST:
            continue
        regressor = np.concatenate([s.regressor[::thin, :, links][:, pair] for s in states])[known]
        prior = links_prior(body.parameters()[links], LINKS)
        fit = _Fit(regressor, prior, *(each[known][:, pair] for each in (speed, gain, residual)))
        before = fit.errors(SEPARATE)
        turns, after = _best(fit, before)
        held = compared(before, after)
        if held.share > 2 * SHARE and held.sure > SURE and held.again and -held.rise > EACH:
            rms = [np.sqrt(np.sum(errors, axis=0) / fit.rows) * fit.size for errors in (before, after)]
            found.append((held.share, Coupling((a, b), turns, *rms)))
    return _apart(found)


def _best(fit: _Fit, before: Float) -> tuple[Turns, Float]:
    """The structure that removes most of the errors ``before`` (K, 2) of separate motors, and its errors (K, 2)."""
    errors = dict[Turns, Float]()

    def best(structures: Iterable[Turns]) -> Turns:
        for turns in (tried := list(structures)):
            if turns not in errors:
                errors[turns] = fit.errors(turns)
        return max(tried, key=lambda turns: compared(before, errors[turns]).share)

    plain = best([DIFFERENTIAL, *_turned(1.0), *_turned(-1.0)])
    found = best([plain, *(turns for ratio in RATIOS for way in (1, -1) for turns in _turned(way * ratio))])
    if found == DIFFERENTIAL or compared(before, errors[found]).share < SHARE:
        return found, errors[found]
    motor = 0 if found[0][1] else 1
    for step in FINER:
        found = best(_turned(found[motor][1 - motor] * step**k)[motor] for k in range(-3, 4))
    better = compared(errors[plain], errors[found])
    chosen = found if better.share > 0 and better.sure > SURE and better.again else plain
    return chosen, errors[chosen]


def _turned(ratio: float) -> tuple[Turns, Turns]:
    """The motor of the first joint, or that of the second one, also turns with the other joint."""
    return ((1.0, ratio), (0.0, 1.0)), ((1.0, 0.0), (ratio, 1.0))


def _apart(found: Sequence[tuple[float, Coupling]]) -> list[Coupling]:
    """The couplings that remove most, a joint in one of them."""
    chosen = list[Coupling]()
    for _, each in sorted(found, key=lambda pair: -pair[0]):
        if not any(set(each.joints) & set(other.joints) for other in chosen):
            chosen.append(each)
    return chosen


class _Fit:
    """Regressions of the torques of two joints, for any structure of their motors."""

    def __init__(self, regressor: Float, links: Prior, speed: Float, gain: Float, residual: Float) -> None:
        self.rows = len(residual)
        self.size = np.maximum(np.std(residual, axis=0), 1e-9)
        self._motion = speed, gain
        offsets = [Block(np.ones((self.rows, 1)), c, Prior.spread(3 * self.size[c : c + 1])) for c in (0, 1)]
        fixed = [Block(regressor, None, links), *offsets]
        design = Design(residual, np.broadcast_to(np.square(self.size), residual.shape), fixed)
        self._folds = Folds(design, np.arange(self.rows) * FOLDS // self.rows)
        drives = np.sqrt(sum(np.mean(_courses(*each) ** 2, axis=0) for each in zip(speed.T, gain.T, strict=True)))
        self._drive = Prior.spread(3 * self.size.max() / np.maximum(drives, 1e-9))
        self._prior = Prior.joined(*(block.prior for block in fixed), self._drive, self._drive)
        self._motors = dict[tuple[float, float], Block]()

    def errors(self, turns: Turns) -> Float:
        """Squared error (K, 2) of each fold, in units of the residual's variance, in the fit without that fold."""
        motors = [self._motor(each) for each in turns]
        return self._folds.fits(motors, self._prior, np.full(2, ALIKE))[1]

    def _motor(self, turns: tuple[float, float]) -> Block:
        """Torque of a motor per unit; most structures that are compared share one of their motors."""
        if turns not in self._motors:
            load = np.array(turns)
            courses = _courses(*(course @ load for course in self._motion))
            self._motors[turns] = Block(courses[:, None] * load[:, None], None, self._drive)
        return self._motors[turns]


def _courses(speed: Float, gain: Float) -> Float:
    """Torque (N, 4) of a motor per unit: Coulomb and viscous friction, friction that bends, and the rotor."""
    return np.column_stack([direction(speed), speed, np.tanh(speed / BENDS), gain])
