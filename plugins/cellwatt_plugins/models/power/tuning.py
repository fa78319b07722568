"""Choice of the smoothing, and of the width within which friction reverses, by the error of the currents."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from cellwatt.scheduler import spread
from cellwatt_plugins.models.power.design import Belief, Design, Rows, spread_of
from cellwatt_plugins.models.power.moves import Moves
from cellwatt_plugins.models.power.smoothing import Noise, Smoother, Span
from cellwatt_plugins.models.power.terms import ALWAYS
from cellwatt_plugins.models.power.torque import solve, sums_of
from cellwatt_plugins.robot import Arm
from cellwatt_plugins.robot.motion import SIGN_WIDTH

Trial = tuple[Span, Span, float]
"""Spans of velocity and acceleration, and the width, rad/s."""

TRIED: Final = 5000
"""Number of rows of a trial."""
LONGEST: Final = 0.4
"""Longest and shortest window, s."""
SHORTEST: Final = 0.02
SPANS: Final = (3, 5, 7, 9, 11, 15, 21, 27, 35, 45, 61)
"""Numbers of rows in a window."""
IN_SHORT: Final = 0.1
"""Share of the rows that may be in moves shorter than two windows: gaps in a recording leave some short pieces."""
WIDTHS: Final = (0.0005, 0.001, 0.002, 0.003, 0.004, 0.006, 0.008, 0.012, 0.02, 0.04, 0.08)
"""Widths in rad/s that are tried."""
TERMS: Final = (*ALWAYS, "Stribeck friction (0.1 rad/s)", "offset")
DOUBT: Final = 3.0
"""Factor on the tolerances of links until others are tried."""


@dataclass(frozen=True)
class Tuning:
    """The chosen smoothing and width."""

    smoother: Smoother
    width: float
    """rad/s."""


@dataclass(frozen=True)
class _Known:
    """Data of a trial: ``moves``, and the ``noise`` of all of them."""

    moves: Moves
    noise: Noise
    arm: Arm


def tune(moves: Moves, arm: Arm) -> Tuning:
    """Spans of velocity and acceleration one after the other, then the width within which friction reverses."""
    known = _Known(_some(moves), Noise.of(moves), arm)
    step = known.moves.step
    rows = [n for n in SPANS if SHORTEST <= n * step <= LONGEST] or [3]
    lengths = np.sort([b - a for a, b in known.moves.bounds()])
    short = int(lengths[np.searchsorted(np.cumsum(lengths), IN_SHORT * len(known.moves))])
    rows = [n for n in rows if n <= short // 2] or rows[:1]
    slow, fast = [Span(n, 2) for n in rows], [Span(n, 3) for n in rows if n > 3]
    start = min(rows, key=lambda n: abs(n * step - 0.12))
    velocity, acceleration, width = Span(start, 2), Span(max(start, 5), 3), SIGN_WIDTH
    if np.isfinite(known.moves.current).any():
        velocity, *_ = _best([(span, acceleration, width) for span in slow], known)
        *_, width = _best([(velocity, acceleration, each) for each in WIDTHS], known)
        _, acceleration, _ = _best([(velocity, span, width) for span in fast], known)
        velocity, *_ = _best([(span, acceleration, width) for span in slow], known)
        *_, width = _best([(velocity, acceleration, width * near) for near in (0.8, 0.9, 1.0, 1.1, 1.25)], known)
    return Tuning(Smoother.design(known.noise, step, velocity, acceleration), width)


def _best(tried: Sequence[Trial], known: _Known) -> Trial:
    costs = spread(_misfit, tried, "spans and widths", shared=known)
    return tried[min(range(len(tried)), key=costs.__getitem__)]


def _some(moves: Moves) -> Moves:
    """Enough moves for the trials, evenly spread."""
    each = len(moves) / moves.count
    wanted = max(1, round(4 * TRIED / each))
    return moves if wanted >= moves.count else moves.only(np.linspace(0, moves.count - 1, wanted).astype(int).tolist())


def _misfit(trial: Trial, known: _Known) -> float:
    """Sum over the joints of the logarithm of the mean square torque residual."""
    velocity, acceleration, width = trial
    arm, smoother = known.arm, Smoother.design(known.noise, known.moves.step, velocity, acceleration)
    rows = Rows.of(known.moves, smoother, arm.column("torque_constant"), TRIED, whole=False)
    design, _ = Design.stated(rows, arm.body, width, TERMS)
    scale = spread_of(rows.torque) + 1e-9
    belief = Belief.of(arm, design, scale, DOUBT)
    variance = np.broadcast_to((0.05 * scale) ** 2, rows.torque.shape)
    sums = sums_of(design, rows.torque, variance, np.ones(len(rows), bool))
    residual = rows.torque - solve(sums, belief, range(len(TERMS))).torque(design)
    return float(np.sum(np.log(np.nanmean(residual[:, np.isfinite(residual).any(axis=0)] ** 2, axis=0))))
