"""Cycles judged as they run and as they end, by the same formulas as a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import takewhile

import numpy as np

from cellwatt.arrays import Float
from cellwatt.progress import steps
from cellwatt.results import Alarm
from cellwatt_plugins.faults.cycles.alarms import CycleAlarms
from cellwatt_plugins.faults.cycles.findings import CycleFinding, judge_begun, judge_cycle, stranger
from cellwatt_plugins.faults.cycles.known import Known
from cellwatt_plugins.faults.cycles.match import Match, begun_cycle, find_cycles
from cellwatt_plugins.faults.cycles.new_tasks import new_tasks
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.cycles.runs import Run, find_runs
from cellwatt_plugins.faults.trace import Trace

REST = 0.5
"""Frames are looked at once the arm has rested for this long, s …"""
LATEST = 15.0
"""… or has not for this long."""
STILL = 0.01
"""rad: what an encoder at rest covers at most."""
BRIEF = 0.16
AT_ONCE = 0.003
"""s of rest after a move, and rad that encoders cover in it, from which the cycle so far is judged."""
PIECE = 0.04
"""Frames are taken in pieces of this, s, so that no rest is missed between them."""
SETTLED = 0.4
"""A cycle is over this long after its last move, s."""
MARGIN = 0.5
"""Frames are kept this long before the first run that is still open, s."""
PATIENCE = 3.0
"""Frames that no cycle claims are kept for so many times the longest cycle that is known."""
GAP = 2.5
"""A hole in the positions of more than so many steps begins a new recording: no cycle goes across."""


@dataclass(frozen=True, slots=True)
class CycleReport:
    """Findings on a cycle that is ``over``; of one under way only its faults so far."""

    finding: CycleFinding
    over: bool


class CycleWatch:
    """Takes frames of one arm on an even grid of ``step`` s; tells faults after the move that shows them, and what is
    said of each cycle once it is over."""

    def __init__(self, known: Known, step: float) -> None:
        self._known, self._step = known, step
        longest = max(float(pattern.time[-1]) for pattern in known.patterns)
        self._keep = PATIENCE * longest
        self._looked, self._moved, self._fresh_move, self._due = -np.inf, False, False, np.inf
        self._seen = Recording(np.empty(0), np.empty((0, len(known.patterns[0].repeat))), np.empty(0), known.meter)

    @property
    def behind(self) -> float:
        """s that cycles are told later because of a slow meter: its last value of a cycle comes so late."""
        return 0.0 if self._known.meter is None else self._known.meter.delay

    def feed(self, time: Float, position: Float, power: Float) -> list[CycleReport]:
        """Return what n more frames settle: ``time`` (n,) s, ``position`` (n, joints) rad, ``power`` (n,) W."""
        there = ~np.isnan(position).any(axis=1)
        time, position, power = time[there], position[there], power[there]
        size = max(1, round(PIECE / self._step))
        pieces = [slice(begin, begin + size) for begin in range(0, len(time), size)]
        return [
            told
            for piece in steps(pieces, "judging stretch")
            for told in self._take(time[piece], position[piece], power[piece])
        ]

    def close(self) -> list[CycleReport]:
        """Return what the end of the frames settles."""
        return self._look(ended=True)

    def _take(self, time: Float, position: Float, power: Float) -> list[CycleReport]:
        found: list[CycleReport] = []
        if len(self._seen.time) and time[0] - self._seen.time[-1] > GAP * self._step:
            found = self._look(ended=True)
            self._forget()
        self._seen = replace(
            self._seen,
            time=np.concatenate([self._seen.time, time]),
            position=np.concatenate([self._seen.position, position]),
            power=np.concatenate([self._seen.power, power]),
        )
        if self._move_has_ended():
            found += self._glance()
        return [*found, *self._look(ended=False)] if self._worth_a_look(len(time)) else found

    def _move_has_ended(self) -> bool:
        """True if the arm has come to a brief rest since the last move."""
        width = max(2, round(BRIEF / self._step))
        still = bool(np.all(np.ptp(self._seen.position[-width:], axis=0) <= AT_ONCE))
        ended = self._fresh_move and still
        self._fresh_move = not still
        return ended

    def _worth_a_look(self, fresh: int) -> bool:
        """True if the arm has come to rest since the last look, or power has caught up with its rest; ``fresh`` frames
        are new.
        """
        rest = self._seen.position[-max(2, round(REST / self._step)) :]
        newest = self._seen.position[-max(fresh, len(rest)) :]
        self._moved = self._moved or bool(np.any(np.ptp(newest, axis=0) > STILL))
        still = bool(np.all(np.ptp(rest, axis=0) <= STILL))
        now = float(self._seen.time[-1])
        rested = self._moved and still
        if not rested and now < min(self._due, self._looked + LATEST):
            return False
        self._due = now + self.behind if rested and self.behind else np.inf
        self._moved, self._looked = not still, now
        return True

    def _glance(self) -> list[CycleReport]:
        """Faults that the cycle under way shows already."""
        match = None if self._few else begun_cycle(self._seen, find_runs(self._seen), self._known.patterns)
        if match is None:
            return []
        finding = judge_begun(self._seen, match, self._known)
        return [CycleReport(finding, over=False)] if finding.faults else []

    @property
    def _few(self) -> bool:
        """True if frames that are kept are too few to show a rest."""
        return len(self._seen.time) < max(2, 2 * round(SETTLED / self._step))

    def _forget(self) -> None:
        self._drop(len(self._seen.time))
        self._looked, self._moved, self._fresh_move, self._due = -np.inf, False, False, np.inf

    def _look(self, *, ended: bool) -> list[CycleReport]:
        """Cycles that are over, with what came before them; their frames are dropped."""
        if self._few:
            return []
        recording, runs = self._seen, find_runs(self._seen)
        matches = find_cycles(recording, runs, self._known.patterns)
        over = list(takewhile(lambda match: ended or self._is_over(match, runs), matches))
        last = len(runs) - 1 if ended else over[-1].last if over else -1
        if not over and len(runs) and recording.time[-1] - recording.time[runs[0].first] > self._keep:
            # Nothing claims these runs: the older half of them is told as strange and dropped.
            last = len(runs) // 2
        if last < 0:
            self._drop(runs[0].first - self._margin if runs else len(recording.time) - self._margin)
            return []
        strange = new_tasks(runs[: last + 1], over, self._known.patterns)
        found = [judge_cycle(recording, m, self._known)[0] for m in over]
        found += [stranger(recording, runs[first : end + 1]) for first, end in strange]
        # What is told of must leave nothing behind that would be a run again.
        following = runs[last + 1].first if last + 1 < len(runs) else len(recording.time)
        self._drop(max(runs[last].last, following - self._margin))
        return [CycleReport(finding, over=True) for finding in sorted(found, key=lambda finding: finding.start)]

    def _is_over(self, match: Match, runs: list[Run]) -> bool:
        """True if nothing more of a cycle can come: a last move that encoders do not show may still be due."""
        pattern = self._known.patterns[match.pattern]
        if len(pattern.moves) - 1 in match.unseen:
            return match.last + 1 < len(runs)
        return float(self._seen.time[-1]) > float(match.warp.t[-1]) + SETTLED + self.behind

    @property
    def _margin(self) -> int:
        return round(MARGIN / self._step)

    def _drop(self, before: int) -> None:
        """Forget frames up to a sample."""
        kept, seen = slice(max(0, before), None), self._seen
        self._seen = replace(seen, time=seen.time[kept], position=seen.position[kept], power=seen.power[kept])


class CycleStage:
    """Whole cycles of one arm judged while frames of ``step`` ns come."""

    def __init__(self, known: Known, step: int, alarms: CycleAlarms) -> None:
        self._watch = CycleWatch(known, step * 1e-9)
        self._alarms = replace(alarms, behind=self._watch.behind)
        self._count = 0
        self._epoch: int | None = None

    def process(self, block: Trace) -> list[Alarm]:
        """Alarms that changed with some more frames."""
        if not len(block):
            return []
        if self._epoch is None:
            self._epoch = int(block.time[0])
        told = self._watch.feed(block.since(self._epoch), block.position, block.power)
        return self._alarmed(told, self._epoch)

    def close(self) -> list[Alarm]:
        """Alarms that the end of the frames settles."""
        return [] if self._epoch is None else self._alarmed(self._watch.close(), self._epoch)

    def _alarmed(self, told: Sequence[CycleReport], epoch: int) -> list[Alarm]:
        out: list[Alarm] = []
        for cycle in told:
            self._count += cycle.over
            if cycle.over:
                out += self._alarms.take(cycle.finding, self._count, epoch)
            else:
                out += self._alarms.take_early(cycle.finding, epoch)
        return out
