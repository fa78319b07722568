"""Inputs of the network for a cycle: mean residuals of power in parts of each move and rest, the pace of each move,
and how far each encoder is off its path in each rest."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.faults.cycles.match import Match
from cellwatt_plugins.faults.cycles.pattern import Pattern
from cellwatt_plugins.faults.cycles.recording import Recording

Float = NDArray[np.float64]

PARTS = 8
"""Parts of a move, of equal length."""
APART = 0.03
"""s of a rest next to a move that belong to neither."""
PACE = 20.0
"""Inputs are the share by which a move is faster than the pattern, times this."""


@dataclass(frozen=True)
class Bins:
    """The parts of a task's moves and rests; ``pattern`` its healthy cycle."""

    pattern: Pattern

    @property
    def moves(self) -> int:
        """Number of moves of the task."""
        return len(self.pattern.moves)

    @property
    def joints(self) -> int:
        """Number of joints of the arm."""
        return len(self.pattern.repeat)

    @property
    def power(self) -> int:
        """Inputs that are residuals of power: parts of moves, then rests from that before the first."""
        return PARTS * self.moves + self.moves + 1

    @property
    def names(self) -> tuple[str, ...]:
        """Every input, in order."""
        parts = [f"move_{m + 1}.part_{k + 1}.power" for m in range(self.moves) for k in range(PARTS)]
        rests = [f"rest_{r}.power" for r in range(self.moves + 1)]
        pace = [f"move_{m + 1}.pace" for m in range(self.moves)]
        off = [f"rest_{r}.joint_{j + 1}.position" for r in range(self.moves + 1) for j in range(self.joints)]
        return (*parts, *rests, *pace, *off)

    @cached_property
    def edges(self) -> tuple[Float, Float]:
        """Start and end (power,) of each of them, s of the pattern."""
        start, end = [], []
        for begin, stop in self.pattern.moves:
            cuts = np.linspace(begin, stop, PARTS + 1)
            start += cuts[:-1].tolist()
            end += cuts[1:].tolist()
        last = float(self.pattern.time[-1])
        moves = [(0.0, 0.0), *self.pattern.moves, (last, last)]
        for (_, before), (after, _) in pairwise(moves):
            start.append(before + APART * (before > 0))
            end.append(after - APART * (after < last))
        return np.array(start), np.array(end)

    def part_of(self, tau: Float) -> NDArray[np.int64]:
        """Parts in which times tau (N,) s of the pattern lie; -1 in none."""
        start, end = self.edges
        order = np.argsort(start)
        found = order[np.clip(np.searchsorted(start[order], tau, side="right") - 1, 0, len(order) - 1)]
        return np.asarray(np.where((tau >= start[found]) & (tau < end[found]), found, -1), np.int64)

    def means(self, tau: Float, values: Float) -> Float:
        """Means (power, …) of values (N, …) at times tau (N,); 0 where nothing is known."""
        part = self.part_of(tau)
        known = (part >= 0) & ~np.isnan(values.reshape(len(tau), -1)).any(axis=1)
        count = np.bincount(part[known], minlength=self.power)
        flat = values.reshape(len(tau), -1)[known]
        total = np.stack([np.bincount(part[known], column, self.power) for column in flat.T], axis=1)
        return np.asarray(total / np.maximum(count, 1)[:, None]).reshape(self.power, *values.shape[1:])


def inputs_of(recording: Recording, match: Match, bins: Bins) -> Float:
    """Inputs (inputs,) of the network for one cycle, in W, shares and rad."""
    pattern, warp = bins.pattern, match.warp
    edges = warp.to_recording(np.array([0.0, pattern.time[-1]]))
    first, last = np.searchsorted(recording.time, edges)
    rows = slice(int(first), int(last) + 1)
    tau = warp.to_pattern(recording.time[rows])
    residual = recording.power[rows] - np.interp(tau, pattern.time, pattern.power)
    residual[_in(tau, pattern, match.broken)] = np.nan
    off = recording.position[rows] - pattern.position_at(tau)
    rests = bins.means(tau, off)[PARTS * bins.moves :]
    return together(bins.means(tau, residual), _pace(match, pattern), rests)


def together(power: Float, pace: Float, rests: Float) -> Float:
    """Inputs (…, inputs) of residuals (…, power) W, paces (…, moves) and deviations (…, moves + 1, joints) rad."""
    return np.concatenate([power, PACE * pace, rests.reshape(*rests.shape[:-2], -1)], axis=-1)


def _in(tau: Float, pattern: Pattern, moves: Sequence[int]) -> NDArray[np.bool_]:
    inside = np.zeros(len(tau), dtype=bool)
    for move in moves:
        start, end = pattern.moves[move]
        inside |= (tau >= start) & (tau <= end)
    return inside


def _pace(match: Match, pattern: Pattern) -> Float:
    """Share (moves,) by which each move is faster than the pattern's; 0 where that is not known."""
    starts, ends = np.array(pattern.moves).T
    lasted = match.warp.to_recording(ends) - match.warp.to_recording(starts)
    pace = (ends - starts) / np.maximum(lasted, 1e-3) - 1.0
    pace[[*match.unseen, *match.broken]] = 0.0
    return np.asarray(np.clip(pace, -0.5, 0.5))
