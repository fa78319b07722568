"""Judges cycles while they run and when they end, with the same formulas as for a recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, takewhile

import numpy as np

from cellwatt.arrays import Float, joined, rows_of
from cellwatt.progress import steps
from cellwatt.results import Alarm
from cellwatt_plugins.faults.cycles.alarms import CycleAlarms
from cellwatt_plugins.faults.cycles.findings import CycleFinding, judge_begun, judge_cycle, stranger
from cellwatt_plugins.faults.cycles.known import Known
from cellwatt_plugins.faults.cycles.match import Match, begun_cycle, find_cycles
from cellwatt_plugins.faults.cycles.new_tasks import new_tasks
from cellwatt_plugins.faults.cycles.recording import LONGEST_HOLE, Recording
from cellwatt_plugins.faults.cycles.runs import Run, find_runs, jumps
from cellwatt_plugins.faults.trace import Trace
from cellwatt_plugins.robot.samples import interpolated

REST = 0.5
"""Frames are judged once the arm has rested for this long, s …"""
LATEST = 15.0
"""… or at the latest after this time, s."""
STILL = 0.01
"""Largest range of an encoder at rest, rad."""
BRIEF = 0.16
AT_ONCE = 0.003
"""Rest after a move, s, and largest range of the encoders in it, rad, after which the running cycle is judged."""
PIECE = 0.04
"""Frames are processed in pieces of this length, s, so that no rest is missed."""
SETTLED = 0.4
"""Time after its last move at which a cycle is over, s."""
MARGIN = 0.5
"""Time before the first open run for which frames are stored, s."""
PATIENCE = 3.0
"""Time for which frames that belong to no cycle are stored, in durations of the longest known cycle."""
GAP = 2.5
"""A hole in the positions is interpolated as in a recording, or up to this many steps; a longer one starts a new
recording, and no cycle spans it."""


@dataclass(frozen=True, slots=True)
class CycleReport:
    """Finding on a cycle that is ``over``, or the faults so far of a running one; ``matched`` if it is a known one."""

    finding: CycleFinding
    over: bool
    matched: bool = True


class CycleWatch:
    """Judges frames of one arm on an even grid of ``step`` s; reports a fault after the move that shows it, and the
    finding on each cycle once it is over."""

    def __init__(self, known: Known, step: float) -> None:
        self._known, self._step = known, step
        longest = max(float(pattern.time[-1]) for pattern in known.patterns)
        self._keep, self._longest_hole = PATIENCE * longest, max(LONGEST_HOLE, GAP * step)
        self._looked, self._moved, self._fresh_move, self._due = -np.inf, False, False, np.inf
        self._seen = Recording(np.empty(0), np.empty((0, len(known.patterns[0].repeat))), np.empty(0), known.meter)
        self._waiting = self._seen
        """The last frame with all positions, which is in ``_seen``, too, and the frames after it."""

    @property
    def behind(self) -> float:
        """Delay of the findings, s: the last value of a cycle from a slow meter arrives so late."""
        return 0.0 if self._known.meter is None else self._known.meter.delay

    def feed(self, time: Float, position: Float, power: Float) -> list[CycleReport]:
        """Return the findings after n frames: ``time`` (n,) s, ``position`` (n, joints) rad or m, ``power`` (n,) W."""
        time, position, power = self._bridged(time, position / self._known.arm.body.levers, power)
        size = max(1, round(PIECE / self._step))
        edges = [0, *(np.flatnonzero(np.diff(time) > self._longest_hole) + 1).tolist(), len(time)]
        pieces = [slice(a, min(a + size, end)) for begin, end in pairwise(edges) for a in range(begin, end, size)]
        return [
            report
            for piece in steps(pieces, "judging stretch")
            for report in self._take(time[piece], position[piece], power[piece])
        ]

    def close(self) -> list[CycleReport]:
        """Return the findings at the end of the frames."""
        return self._look(ended=True)

    def _bridged(self, time: Float, position: Float, power: Float) -> tuple[Float, Float, Float]:
        """The new frames up to the last one with all positions, short holes interpolated; later frames wait."""
        before = len(self._waiting.time) > 0
        new = joined([self._waiting, Recording(time, position, power)])
        time, position, power = new.time, new.position, new.power
        known = np.flatnonzero(~np.isnan(position).any(axis=1))
        if not len(known):
            return time[:0], position[:0], power[:0]
        number = np.round((time - time[known[0]]) / self._step).astype(np.int64)
        there = number[known]
        count = np.diff(there)
        count[count * self._step > self._longest_hole] = 1
        begun = np.repeat(there[:-1] - np.cumsum(count) + count, count)
        grid = np.append(begun + np.arange(len(begun)), there[-1])[before:]
        row = np.searchsorted(number, grid)
        late = time[-1] - time[known[-1]] > self._longest_hole
        self._waiting = rows_of(new, slice(known[-1], known[-1] + 1 if late else None))
        columns = interpolated(grid, there, np.column_stack([time[known], position[known]]))
        return columns[:, 0], columns[:, 1:], np.where(number[row] == grid, power[row], np.nan)

    def _take(self, time: Float, position: Float, power: Float) -> list[CycleReport]:
        found: list[CycleReport] = []
        if len(self._seen.time) and time[0] - self._seen.time[-1] > self._longest_hole:
            found = self._look(ended=True)
            self._forget()
        self._seen = joined([self._seen, Recording(time, position, power)])
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
        """True if the arm has come to rest since the last judgement, or a slow meter's power of the time up to that
        rest has arrived; ``fresh`` is the number of new frames.
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
        """Return the faults of the running cycle so far."""
        match = None if self._few else begun_cycle(self._seen, find_runs(self._seen), self._known.patterns)
        if match is None:
            return []
        finding = judge_begun(self._seen, match, self._known)
        return [CycleReport(finding, over=False)] if finding.faults else []

    @property
    def _few(self) -> bool:
        """True if the stored frames are too few to contain a rest."""
        return len(self._seen.time) < max(2, 2 * round(SETTLED / self._step))

    def _forget(self) -> None:
        self._drop(len(self._seen.time))
        self._looked, self._moved, self._fresh_move, self._due = -np.inf, False, False, np.inf

    def _look(self, *, ended: bool) -> list[CycleReport]:
        """Report the cycles that are over and unknown cycles before them, and discard their frames."""
        if self._few:
            return []
        recording, runs = self._seen, find_runs(self._seen)
        matches = find_cycles(recording, runs, self._known.patterns)
        over = list(takewhile(lambda match: ended or self._is_over(match, runs), matches))
        if len(over) < len(matches) and not self._may_go_on(matches[len(over)]):
            self._due = min(self._due, self._settled(matches[len(over)]))
        last = len(runs) - 1 if ended else over[-1].last if over else -1
        if not over and len(runs) and recording.time[-1] - recording.time[runs[0].first] > self._keep:
            # These runs belong to no known cycle: report the older half as unknown tasks and discard it.
            last = len(runs) // 2
        if last < 0:
            self._drop(self._rest(0, runs[0].first if runs else len(recording.time)))
            return []
        strange = new_tasks(runs[: last + 1], over, self._known.patterns)
        found = [CycleReport(judge_cycle(recording, m, self._known)[0], over=True) for m in over]
        found += [CycleReport(stranger(recording, runs[a : b + 1]), over=True, matched=False) for a, b in strange]
        # Discard the reported runs completely, so that no remainder is found as a run again.
        following = runs[last + 1].first if last + 1 < len(runs) else len(recording.time)
        self._drop(max(runs[last].last, self._rest(runs[last].last, following)))
        return sorted(found, key=lambda report: report.finding.start)

    def _is_over(self, match: Match, runs: list[Run]) -> bool:
        """True if a cycle is complete; a last move that the encoders do not show may still follow."""
        if self._may_go_on(match):
            return match.last + 1 < len(runs)
        return float(self._seen.time[-1]) > self._settled(match)

    def _may_go_on(self, match: Match) -> bool:
        return len(self._known.patterns[match.pattern].moves) - 1 in match.unseen

    def _settled(self, match: Match) -> float:
        """Time after which a cycle is over and all its power has arrived, s."""
        return float(match.warp.t[-1]) + SETTLED + self.behind

    def _rest(self, begin: int, end: int) -> int:
        """First sample to keep of a rest: a jump of an encoder shows that it has hidden a move."""
        seen = self._seen
        jumped = begin + np.flatnonzero(jumps(seen.position[begin:end]).any(axis=1))
        recent = jumped[seen.time[jumped] > seen.time[-1] - self._keep]
        return int(min([end, *recent])) - round(MARGIN / self._step)

    def _drop(self, before: int) -> None:
        """Discard frames before the sample with index ``before``."""
        self._seen = rows_of(self._seen, slice(max(0, before), None))


class CycleStage:
    """Judges whole cycles of one arm on live frames with a step of ``step`` ns."""

    def __init__(self, known: Known, step: int, alarms: CycleAlarms) -> None:
        self._watch = CycleWatch(known, step * 1e-9)
        self._alarms = replace(alarms, behind=self._watch.behind)
        self._count = 0
        self._epoch: int | None = None

    def process(self, block: Trace) -> list[Alarm]:
        """Return the alarms that changed with a block of frames."""
        if not len(block):
            return []
        if self._epoch is None:
            self._epoch = int(block.time[0])
        return self._alarmed(self._watch.feed(block.since(self._epoch), block.position, block.power), self._epoch)

    def close(self) -> list[Alarm]:
        """Return the alarms that changed at the end of the frames."""
        return [] if self._epoch is None else self._alarmed(self._watch.close(), self._epoch)

    def _alarmed(self, reports: Sequence[CycleReport], epoch: int) -> list[Alarm]:
        out: list[Alarm] = []
        for report in reports:
            self._count += report.over
            if report.over:
                out += self._alarms.take(report.finding, self._count, epoch, matched=report.matched)
            else:
                out += self._alarms.take_early(report.finding, epoch)
        return out
