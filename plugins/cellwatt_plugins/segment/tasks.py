"""Recognises tasks, the sequences of intervals that recur, while they run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from cellwatt.results import Interval, Task
from cellwatt_plugins.segment.settings import SegmentSettings

HISTORY = 512
"""Moves stored; a task of more than half as many moves is not recognised."""
MOST_TASKS = 64
"""Tasks stored; a new one replaces the task that was seen least recently."""
REST_MARGIN = 0.04
"""A rest marks the beginning of a task if it is longer than every other rest by more than this, s."""


def alike(a: Interval, b: Interval, likeness: SegmentSettings) -> bool:
    """True if two intervals are the same motion: same joints, start pose and displacement, at any speed."""
    return (
        a.moving == b.moving
        and all(abs(x - y) <= likeness.same_displacement for x, y in zip(a.displacement, b.displacement, strict=True))
        and all(abs(x - y) <= likeness.same_pose for x, y in zip(a.pose, b.pose, strict=True))
    )


def signature(moves: Sequence[Interval]) -> str:
    """The motion as text: moving joints with displacements in whole signed degrees, e.g. ``1+52 2+20,5-29``.

    Rounded up from .63 of a degree, far from programmed angles (whole, halves, quarters), so that every recording of
    a motion gives the same text.
    """
    return " ".join(
        ",".join(f"{joint}{math.floor(math.degrees(move.displacement[joint - 1]) + 0.37):+d}" for joint in move.moving)
        for move in moves
    )


@dataclass(slots=True)
class Move:
    """An interval in which a joint moved, with the ``rest`` before it, s; ``broken``: data were lost before it."""

    interval: Interval
    rest: float
    broken: bool
    claimed: bool = False

    @property
    def seconds(self) -> float:
        """Duration, s."""
        return (self.interval.end - self.interval.start) * 1e-9


@dataclass(slots=True)
class Known:
    """A recognised task: its ``moves`` in order, the moving time of each variant, s, and the repetitions seen."""

    name: str
    signature: str
    moves: tuple[Interval, ...]
    durations: list[float] = field(default_factory=list)
    repetitions: int = 0
    last: int = 0

    def variant(self, duration: float, likeness: SegmentSettings) -> float:
        """Speed relative to the fastest variant seen; adds a variant if no known one has this ``duration`` (s)."""
        near = [d for d in self.durations if abs(duration / d - 1) <= likeness.same_speed]
        if not near:
            self.durations.append(duration)
            near = [duration]
        return min(self.durations) / min(near, key=lambda d: abs(duration - d))


def beginning(moves: Sequence[Move], period: int) -> int:
    """Index (0 … period - 1) of the move with which the task begins, from the moves of two repetitions.

    The task begins after its longest rest: the shorter rest of the two repetitions counts, so that a chance pause
    does not, and the rest before the first move is ignored, as it follows another motion. If no rest is the longest
    by ``REST_MARGIN``, the task begins at the rotation whose signature is alphabetically first.
    """
    rests = [moves[period].rest, *(min(moves[i].rest, moves[i + period].rest) for i in range(1, period))]
    order = sorted(range(period), key=lambda i: rests[i], reverse=True)
    if period == 1 or rests[order[0]] - rests[order[1]] > REST_MARGIN:
        return order[0]
    intervals = [m.interval for m in moves]
    return min(range(period), key=lambda i: signature(intervals[i : i + period]))


@dataclass
class TaskRecogniser:
    """Finds tasks in a stream of closed intervals.

    A task is found when a run of moves occurs twice in a row (shortest repeating unit), or when a run between two
    known tasks that ends in its start pose occurs a second time. From then on each repetition is reported when its
    last move ends; earlier repetitions are reported when the task is found.
    """

    likeness: SegmentSettings = field(default_factory=SegmentSettings)

    def __post_init__(self) -> None:
        self._moves: list[Move] = []
        self._known: list[Known] = []
        self._between: list[list[Move]] = []
        self._named = 0
        self._rest = 0.0
        self._broken = True

    def update(self, interval: Interval) -> list[Task]:
        """Return the repetitions found with one more closed interval."""
        if not interval.complete:
            self._broken, self._rest = True, 0.0
            return []
        if max(map(abs, interval.displacement)) <= self.likeness.same_displacement:
            self._rest += (interval.end - interval.start) * 1e-9
            return []
        self._moves = [*self._moves[1 - HISTORY :], Move(interval, self._rest, self._broken)]
        self._broken, self._rest = False, 0.0
        return self._repeat() or self._recur()

    def _repeat(self) -> list[Task]:
        """The shortest known task that ends with the newest move, if any."""
        end = len(self._moves)
        for known in sorted(self._known, key=lambda k: len(k.moves)):
            first = end - len(known.moves)
            if self._is(known, first):
                found = [self._claim(known, first)]
                return self._gap_before(first) + found
        return []

    def _recur(self) -> list[Task]:
        """A new task if the newest moves repeat the moves just before them."""
        run = self._free_run(len(self._moves))
        for period in range(1, len(run) // 2 + 1):
            twice = run[-2 * period :]
            if all(self._same(twice[i], twice[i + period]) for i in reversed(range(period))):
                first = beginning(twice, period)
                return self._learn(twice[first : first + period])
        return []

    def _gap_before(self, first: int) -> list[Task]:
        """A new task if the run between two known tasks ends in its start pose and was seen before."""
        run = self._free_run(first)
        before = first - len(run) - 1
        if not run or before < 0 or not self._moves[before].claimed or run[0].broken or not self._closes(run):
            return []
        for other in self._between:
            if len(other) == len(run) and all(map(self._same, run, other)):
                self._between.remove(other)
                return self._learn(run)
        self._between = [*self._between[-31:], run]
        return []

    def _learn(self, unit: Sequence[Move]) -> list[Task]:
        """Name a new task and claim every repetition so far; discard known longer tasks that contain it."""
        moves = tuple(m.interval for m in unit)
        self._known = [k for k in self._known if not self._contains(k.moves, moves)]
        self._named += 1
        known = Known(f"task_{self._named}", signature(moves), moves)
        self._known = [*sorted(self._known, key=lambda k: k.last)[1 - MOST_TASKS :], known]
        found, first = [], 0
        while first + len(moves) <= len(self._moves):
            if self._is(known, first):
                found.append(self._claim(known, first))
                first += len(moves)
            else:
                first += 1
        return found

    def _claim(self, known: Known, first: int) -> Task:
        moves = self._moves[first : first + len(known.moves)]
        for move in moves:
            move.claimed = True
        start, end = moves[0].interval, moves[-1].interval
        known.repetitions += 1
        known.last = end.end
        speed = known.variant(sum(m.seconds for m in moves), self.likeness)
        return Task(
            source=start.source,
            name=known.name,
            signature=known.signature,
            variant=f"speed={speed:.2f}",
            speed=speed,
            start=start.start,
            end=end.end,
            intervals=tuple(range(start.number, end.number + 1)),
            repetition=known.repetitions,
        )

    def _is(self, known: Known, first: int) -> bool:
        """True if the unclaimed moves from ``first`` on are one repetition of a task."""
        moves = self._moves[max(first, 0) : first + len(known.moves)]
        return (
            first >= 0
            and not any(m.claimed for m in moves)
            and not any(m.broken for m in moves[1:])
            and all(alike(m.interval, k, self.likeness) for m, k in zip(moves, known.moves, strict=True))
        )

    def _free_run(self, end: int) -> list[Move]:
        """The unclaimed moves that end before index ``end``, back to the last loss of data."""
        first = end
        while first > 0 and not self._moves[first - 1].claimed and (first == end or not self._moves[first].broken):
            first -= 1
        return self._moves[first:end]

    def _same(self, a: Move, b: Move) -> bool:
        return alike(a.interval, b.interval, self.likeness)

    def _closes(self, run: Sequence[Move]) -> bool:
        """True if a run ends in the pose in which it began."""
        first, last = run[0].interval, run[-1].interval
        return all(
            abs(p + d - q) <= self.likeness.same_pose
            for p, d, q in zip(last.pose, last.displacement, first.pose, strict=True)
        )

    def _contains(self, long: Sequence[Interval], short: Sequence[Interval]) -> bool:
        """True if repetitions of the task ``long`` contain the task ``short``."""
        twice = [*long, *long]
        return any(
            all(alike(a, b, self.likeness) for a, b in zip(twice[i:], short, strict=False)) for i in range(len(long))
        )
