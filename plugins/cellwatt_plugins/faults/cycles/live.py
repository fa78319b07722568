"""Cycles judged as they end, by the same formulas as a recording."""

from __future__ import annotations

from itertools import takewhile

import numpy as np
from numpy.typing import NDArray

from cellwatt_plugins.faults.cycles.findings import CycleFinding, judge_cycle, stranger
from cellwatt_plugins.faults.cycles.known import Known
from cellwatt_plugins.faults.cycles.match import Match, find_cycles
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.cycles.runs import Run, find_runs
from cellwatt_plugins.faults.cycles.strangers import new_tasks

Float = NDArray[np.float64]

REST = 0.5
"""Frames are looked at once the arm has rested for this long, s …"""
LATEST = 15.0
"""… or has not for this long."""
STILL = 0.01
"""rad: what an encoder at rest covers at most."""
SETTLED = 0.4
"""A cycle is over this long after its last move, s."""
MARGIN = 0.5
"""Frames are kept this long before the first run that is still open, s."""
PATIENCE = 3.0
"""Frames that no cycle claims are kept for so many times the longest cycle that is known."""
GAP = 2.5
"""A hole in the positions of more than so many steps begins a new recording: no cycle goes across."""


class CycleWatch:
    """Takes frames of one arm on an even grid of ``step`` s; gives what is said of each cycle once it is over."""

    def __init__(self, known: Known, step: float) -> None:
        self._known, self._step = known, step
        longest = max(float(pattern.time[-1]) for pattern in known.patterns)
        self._keep = PATIENCE * longest
        self._looked, self._moved = -np.inf, False
        self._time: Float = np.empty(0)
        self._power: Float = np.empty(0)
        self._position: Float = np.empty((0, len(known.patterns[0].repeat)))

    def feed(self, time: Float, position: Float, power: Float) -> list[CycleFinding]:
        """Findings that n more frames complete: ``time`` (n,) s, ``position`` (n, joints) rad, ``power`` (n,) W."""
        there = ~np.isnan(position).any(axis=1)
        time, position, power = time[there], position[there], power[there]
        if not len(time):
            return []
        found: list[CycleFinding] = []
        if len(self._time) and time[0] - self._time[-1] > GAP * self._step:
            found = self._look(ended=True)
            self._forget()
        self._time = np.concatenate([self._time, time])
        self._position = np.concatenate([self._position, position.reshape(len(time), -1)])
        self._power = np.concatenate([self._power, power])
        return [*found, *self._look(ended=False)] if self._worth_a_look(len(time)) else found

    def _worth_a_look(self, fresh: int) -> bool:
        """Whether the arm has come to rest since the last look; ``fresh`` frames are new."""
        rest = self._position[-max(2, round(REST / self._step)) :]
        newest = self._position[-max(fresh, len(rest)) :]
        self._moved = self._moved or bool(np.any(np.ptp(newest, axis=0) > STILL))
        still = bool(np.all(np.ptp(rest, axis=0) <= STILL))
        if not (self._moved and still) and self._time[-1] - self._looked < LATEST:
            return False
        self._moved, self._looked = not still, float(self._time[-1])
        return True

    def _forget(self) -> None:
        self._drop(len(self._time) + round(MARGIN / self._step))
        self._looked, self._moved = -np.inf, False

    def _look(self, *, ended: bool) -> list[CycleFinding]:
        """Cycles that are over, with what came before them; their frames are dropped."""
        if len(self._time) < 2 * round(SETTLED / self._step):
            return []
        recording = Recording(self._time, self._position, self._power)
        runs = find_runs(recording)
        matches = find_cycles(recording, runs, self._known.patterns)
        over = list(takewhile(lambda match: ended or self._is_over(match, runs), matches))
        last = over[-1].last if over else -1
        if not over and len(runs) and self._time[-1] - self._time[runs[0].first] > self._keep:
            # Nothing claims these runs: the older half of them is told as strange and dropped.
            last = len(runs) // 2
        if last < 0:
            self._drop(runs[0].first if runs else len(self._time))
            return []
        strange = new_tasks(runs[: last + 1], over, self._known.patterns)
        found = [judge_cycle(recording, m, self._known) for m in over]
        found += [stranger(recording, runs[first : end + 1]) for first, end in strange]
        self._drop(runs[last].last)
        return sorted(found, key=lambda finding: finding.start)

    def _is_over(self, match: Match, runs: list[Run]) -> bool:
        """Whether nothing more of a cycle can come: a last move that encoders do not show may still be due."""
        pattern = self._known.patterns[match.pattern]
        if len(pattern.moves) - 1 in match.unseen:
            return match.last + 1 < len(runs)
        return float(self._time[-1]) > float(match.warp.t[-1]) + SETTLED

    def _drop(self, before: int) -> None:
        """Forget frames up to a sample, but for a margin."""
        first = max(0, before - round(MARGIN / self._step))
        self._time, self._position, self._power = self._time[first:], self._position[first:], self._power[first:]
