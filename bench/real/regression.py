"""What a plain regression predicts of motion that it did not see: the yardstick beside `explain`.

Each joint is its own least-squares fit to what the simulation leaves of its torque: Coulomb, viscous and offset, link
parameters as ridge, then greedily whatever lowers the error on seconds left out. No names, no physics to hold to.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.motion import direction
from real.identify import BAND, RATE, low_pass, motion_of, resampled, spread
from real.recording import Float, Recording

BLOCK = 4.0
"""s that are left out together."""
FOLDS = 6
SHARE = 0.02
"""By which the error on seconds left out must fall for one more term."""
MOST_TERMS = 4
RIDGES = (None, 1e-1, 1e-2, 1e-3, 1e-4)
"""Weights that are tried for the links' prior, in units of the torque's variance; None leaves the links as they are."""
PLAIN = ("coulomb", "viscous", "offset")


@dataclass(frozen=True)
class Grid:
    """A recording on an even grid, low-passed: N samples of n joints, (N, n) each."""

    q: Float
    qd: Float
    qdd: Float
    measured: Float
    """Nm, not yet low-passed."""
    simulated: Float

    @staticmethod
    def of(recording: Recording, arm: Arm) -> Grid:
        """Torque as ``arm`` simulates it on the recorded motion, beside the measured one."""
        time, q, qd, qdd = motion_of(recording)
        measured = resampled(time, recording.time, recording.effort(arm.column("torque_constant")))
        return Grid(q, qd, qdd, measured, arm.torque(q, qd, qdd))


def predicted(seen: Sequence[Recording], unseen: Recording, arm: Arm) -> tuple[Float, list[list[str]]]:
    """Torque (N, n) Nm on the grid of ``unseen``, low-passed, and the terms that each joint chose.

    A joint whose torque is not known keeps what is simulated.
    """
    grids = [Grid.of(recording, arm) for recording in seen]
    new = Grid.of(unseen, arm)
    torque, chosen = low_pass(new.simulated, BAND), []
    for joint in range(arm.joints):
        if np.isnan(grids[0].measured[:, joint]).any():
            chosen.append([])
            continue
        fits = [_best(_blocks(grids, arm, joint), ridge) for ridge in RIDGES]
        _, names, solved = min(fits, key=lambda fit: fit[0])
        columns, listed = _columns(new, arm, joint)
        torque[:, joint] += columns[:, [listed.index(name) for name in names]] @ solved
        chosen.append([name for name in names if not name.startswith("link ")])
    return torque, chosen


def _columns(grid: Grid, arm: Arm, joint: int) -> tuple[Float, list[str]]:
    """All columns (N, p), low-passed like the torque, and their names."""
    q, v, load = grid.q[:, joint], grid.qd[:, joint], grid.simulated[:, joint]
    sign = direction(grid.qd)[:, joint]
    one = {"coulomb": sign, "viscous": v, "offset": np.ones_like(v)}
    one |= {f"turn-over {width}": np.tanh(v / width) for width in (0.02, 0.05, 0.1)}
    one |= {f"stribeck {width}": sign * np.exp(-np.square(v / width)) for width in (0.02, 0.05, 0.1, 0.3)}
    one |= {"sqrt": sign * np.sqrt(np.abs(v)), "square": v * np.abs(v), "load": sign * np.abs(load)}
    one |= {"asymmetric": np.abs(v), "spring": q, "gain": load, "rotor": grid.qdd[:, joint]}
    links = arm.body.regressor(grid.q, grid.qd, grid.qdd)[:, joint] * spread(arm.body)[: 10 * arm.joints]
    columns = np.column_stack([*one.values(), links])
    return low_pass(columns, BAND), [*one, *(f"link {i}" for i in range(links.shape[1]))]


@dataclass(frozen=True)
class _Sums:
    """Normal equations of each block: what any choice of columns is fitted and judged by."""

    square: Float
    """(B, p, p)."""
    product: Float
    """(B, p)."""
    target: Float
    """(B,)."""
    names: list[str]


def _blocks(grids: Sequence[Grid], arm: Arm, joint: int) -> _Sums:
    parts = []
    length = int(BLOCK * RATE)
    for grid in grids:
        columns, names = _columns(grid, arm, joint)
        left = low_pass(grid.measured - grid.simulated, BAND)[:, joint]
        inner = range(int(RATE / 2), len(left) - int(RATE / 2), length)
        parts += [(columns[i : i + length], left[i : i + length]) for i in inner]
    return _Sums(
        np.array([c.T @ c for c, _ in parts]),
        np.array([c.T @ y for c, y in parts]),
        np.array([y @ y for _, y in parts]),
        names,
    )


def _best(sums: _Sums, ridge: float | None) -> tuple[float, list[str], Float]:
    """Error on blocks left out, the columns chosen, and their coefficients from all blocks."""
    links = [] if ridge is None else [name for name in sums.names if name.startswith("link ")]
    weight = 0.0 if ridge is None else ridge * float(np.sum(sums.target))
    names = [*PLAIN, *links]
    error = _left_out(sums, names, weight)
    others = [name for name in sums.names if name not in names and not name.startswith("link ")]
    for _ in range(MOST_TERMS):
        tried = {name: _left_out(sums, [*names, name], weight) for name in others if name not in names}
        best = min(tried, key=lambda name: tried[name])
        if tried[best] > (1 - SHARE) * error:
            break
        names, error = [*names, best], tried[best]
    return error, names, _solved(sums, names, weight, np.ones(len(sums.target), dtype=bool))


def _left_out(sums: _Sums, names: Sequence[str], weight: float) -> float:
    """Root of the sum of squared errors, each fold predicted from the others."""
    fold = np.arange(len(sums.target)) % FOLDS
    at = [sums.names.index(name) for name in names]
    total = 0.0
    for one in range(min(FOLDS, len(fold))):
        out = fold == one
        solved = _solved(sums, names, weight, ~out)
        square, product = sums.square[out].sum(axis=0)[np.ix_(at, at)], sums.product[out].sum(axis=0)[at]
        total += float(sums.target[out].sum() - 2 * product @ solved + solved @ square @ solved)
    return float(np.sqrt(max(total, 0.0)))


def _solved(sums: _Sums, names: Sequence[str], weight: float, kept: np.ndarray) -> Float:
    at = [sums.names.index(name) for name in names]
    square = sums.square[kept].sum(axis=0)[np.ix_(at, at)]
    held = np.array([weight if name.startswith("link ") else 1e-9 * square.trace() for name in names])
    return np.linalg.solve(square + np.diag(held), sums.product[kept].sum(axis=0)[at])
