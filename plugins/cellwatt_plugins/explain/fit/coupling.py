"""Coupled joints: a motor that also turns while another joint moves, as in many wrists and parallelograms.

The friction and the rotor of such a motor follow its own speed, the sum or the difference of two joints' speeds, and
load both joints. A structure is accepted if it predicts the torques of both joints clearly better on data left out
than separate motors do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from cellwatt.arrays import Float
from cellwatt_plugins.explain.fit.leave_out import compared
from cellwatt_plugins.robot.body import PER_LINK
from cellwatt_plugins.robot.effects.states import States
from cellwatt_plugins.robot.motion import direction
from cellwatt_plugins.robot.priors import links_prior
from cellwatt_plugins.robot.regression import Prior, Products

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
STRUCTURES = (
    ((1, 0), (1, 1)),
    ((1, 0), (-1, 1)),
    ((1, 1), (0, 1)),
    ((1, -1), (0, 1)),
    ((1, 1), (-1, 1)),
)
"""Turns of both motors per turn of each joint: a motor that also turns with the other joint, and a differential."""
SPEEDS = (1, 0), (0, 1), (1, 1), (-1, 1)
"""Speeds of a motor in these structures, up to the sign, as factors on both joints' speeds."""

Turns = tuple[tuple[int, int], tuple[int, int]]


@dataclass(frozen=True)
class Coupling:
    """Two coupled joints."""

    joints: tuple[int, int]
    """0-based."""
    turns: Turns
    """Turns of both joints' motors, a row each, per turn of each joint."""
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
        for turns in STRUCTURES:
            after = fit.errors(turns)
            held = compared(before, after)
            if held.share > 2 * SHARE and held.sure > SURE and held.again and -held.rise > EACH:
                rms = [np.sqrt(np.sum(errors, axis=0) / fit.rows) * fit.size for errors in (before, after)]
                found.append((held.share, Coupling((a, b), turns, *rms)))
    return _apart(found)


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
        self._links = regressor.shape[2]
        drives = [_courses(speed @ np.array(turn), gain @ np.array(turn)) for turn in SPEEDS]
        courses = np.concatenate([*drives, np.ones((len(speed), 1))], axis=1)
        fold = np.arange(len(residual)) * FOLDS // self.rows
        self._products = [
            [
                Products.of(
                    np.concatenate([regressor[rows, c], courses[rows]], axis=1) / self.size[c],
                    residual[rows, c] / self.size[c],
                )
                for rows in (fold == k for k in range(FOLDS))
            ]
            for c in (0, 1)
        ]
        wide = self.size.max() / np.maximum(np.sqrt(np.mean(drives[0] ** 2 + drives[1] ** 2, axis=0)), 1e-9)
        self._prior = Prior.joined(links, Prior.spread(np.concatenate([wide, wide, self.size]) * 3))

    def errors(self, turns: Turns) -> Float:
        """Squared error (K, 2) of each fold, in units of the residual's variance, in the fit without that fold."""
        maps = [self._map(turns, c) for c in (0, 1)]
        grams = np.array([[m.T @ p.gram @ m for p in own] for m, own in zip(maps, self._products, strict=True)])
        pulls = np.array([[m.T @ p.pull for p in own] for m, own in zip(maps, self._products, strict=True)])
        squares = np.array([[p.square for p in own] for own in self._products])
        whole, pulled = grams.sum(axis=(0, 1)) / ALIKE + self._prior.precision, pulls.sum(axis=(0, 1)) / ALIKE
        out = np.empty((FOLDS, 2))
        for k in range(FOLDS):
            x = np.linalg.solve(whole - grams[:, k].sum(axis=0) / ALIKE, pulled - pulls[:, k].sum(axis=0) / ALIKE)
            out[k] = squares[:, k] - 2 * pulls[:, k] @ x + np.einsum("i,cij,j->c", x, grams[:, k], x)
        return np.maximum(out, 0.0)

    def _map(self, turns: Turns, channel: int) -> Float:
        """From coefficients (links, both motors, both offsets) to those of the products' columns at a channel."""
        each = len(_courses(np.zeros(1), np.zeros(1))[0])
        out = np.zeros((self._links + each * len(SPEEDS) + 1, self._links + 2 * each + 2))
        out[: self._links, : self._links] = np.eye(self._links)
        for motor, turn in enumerate(turns):
            sign, at = next((s, i) for i, own in enumerate(SPEEDS) for s in (1, -1) if (s * own[0], s * own[1]) == turn)
            rows, columns = (self._links + each * i for i in (at, motor))
            out[rows : rows + each, columns : columns + each] = sign * turn[channel] * np.eye(each)
        out[-1, -2 + channel] = 1.0
        return out


def _courses(speed: Float, gain: Float) -> Float:
    """Torque (N, 4) of a motor per unit: Coulomb and viscous friction, friction that bends, and the rotor."""
    return np.column_stack([direction(speed), speed, np.tanh(speed / BENDS), gain])
