"""Judges intervals: power while an interval runs, encoders once the next interval shows that the task continues."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from cellwatt.results import Interval
from cellwatt_plugins.faults.criteria import Tolerance, Verdict, outside, sustained, verdict
from cellwatt_plugins.faults.intervals.compare import Comparison, compare, power_agrees
from cellwatt_plugins.faults.intervals.follow import Follower, IntervalKey, Match
from cellwatt_plugins.faults.isolate import likeness
from cellwatt_plugins.faults.reference import Reference, ReferenceInterval
from cellwatt_plugins.faults.trace import Trace

POWER_KNOWN = 0.8
"""Smallest share of measured power with which an interval is judged."""
SAME_DURATION = 0.03
"""Relative difference of duration beyond which a path that fits when stretched is a run at another speed."""
WAY = (-0.05, 1.5)
"""A faulty joint or encoder moves between these shares of the reference displacement; else it is another motion."""
TOGETHER = 0.1
"""Largest difference between the covered shares of displacement of the joints in an interrupted motion."""

Course = Literal["follows", "other_speed", "interrupted", "deviates", "other_motion"]


@dataclass(frozen=True, slots=True)
class Rules:
    """Tolerances, ``frames`` (consecutive frames that count as a deviation), and ``reach``, the onset jitter, s."""

    tolerance: Tolerance = field(default_factory=Tolerance)
    frames: int = 5
    reach: float = 0.04


@dataclass(frozen=True)
class Finding:
    """Finding on one interval.

    ``key`` is ``None`` if the interval is not in the reference. ``code`` is the code of equation (20) for power
    while the motion follows the reference, ``None`` if power could not be judged. ``verdicts`` are for joints whose
    encoder deviates; ``clean`` are joints whose encoder agrees; ``off`` is the largest deviation of each joint, rad.
    ``since`` and ``time`` in ns.
    """

    interval: Interval
    key: IntervalKey | None
    course: Course
    since: int
    time: int
    code: int | None = None
    shape: Mapping[int, float] = field(default_factory=dict)
    verdicts: Mapping[int, Verdict] = field(default_factory=dict)
    clean: tuple[int, ...] = ()
    off: tuple[float, ...] = ()
    evidence: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class _Doubt:
    """Joints whose encoder deviated in an interval; the following interval decides whether they are faulty."""

    finding: Finding
    reference: ReferenceInterval
    joints: tuple[int, ...]
    power_outside: bool


class Judge:
    """Judges the intervals of one arm; ``running`` and ``closed`` return findings as soon as they are known."""

    def __init__(self, reference: Reference, rules: Rules) -> None:
        self.follower = Follower(reference)
        self.rules = rules
        self._doubt: _Doubt | None = None
        self._last_end = 0

    def running(self, interval: Interval, trace: Trace, now: int) -> Finding | None:
        """Return a power deviation in a running interval at time ``now`` (ns), if there is one."""
        so_far = replace(interval, end=now)
        match = self.follower.best(so_far, trace)
        if match is None or match.foreign or match.displaced or not interval.complete:
            return None
        reference = self.follower[match.key]
        comparison = self._compare(reference, interval, trace.between(0, now))
        finding = self._power(match, so_far, comparison, "follows", now)
        return finding if finding.code else None

    def closed(self, interval: Interval, trace: Trace) -> list[Finding]:
        """Judge a moving interval at its end, and decide on the encoders of the one before."""
        if not interval.complete:
            self.lost()
            return []
        if self._resumes(interval):
            self._doubt = None
            return []
        match = self.follower.best(interval, trace)
        if match is None:
            return self._unknown(interval)
        reference = self.follower[match.key]
        comparison = self._compare(reference, interval, trace)
        doubtful = self._doubtful(reference, comparison)
        course = _course(reference, interval, trace, doubtful, self.rules)
        if course == "other_motion":
            return self._unknown(interval)
        settled = self._settle(interval, match, trace)
        power = self._power(match, interval, comparison, course, interval.end)
        self._doubt = None
        if course in ("deviates", "interrupted") and comparison.power_known >= POWER_KNOWN:
            outside_power = sustained(comparison.power_codes, self.rules.frames) != 0
            self._doubt = _Doubt(power, reference, doubtful, outside_power)
        self.follower.last, self._last_end = match.key, interval.end
        return [*settled, power]

    def lost(self) -> None:
        """Discard the sequence, as frames are missing."""
        self.follower.last = None
        self._doubt = None

    def _unknown(self, interval: Interval) -> list[Finding]:
        self.lost()
        return [Finding(interval, None, "other_motion", interval.start, interval.end)]

    def _compare(self, reference: ReferenceInterval, interval: Interval, trace: Trace) -> Comparison:
        return compare(reference, interval.start, trace, self.rules.tolerance, self.rules.reach)

    def _doubtful(self, reference: ReferenceInterval, comparison: Comparison) -> tuple[int, ...]:
        """Moving joints whose position is outside the tolerance for ``frames`` consecutive frames, equation (16)."""
        codes = comparison.position_codes(self.rules.tolerance.position)
        return tuple(j for j in reference.moving if sustained(codes[:, j - 1], self.rules.frames))

    def _power(self, match: Match, interval: Interval, comparison: Comparison, course: Course, now: int) -> Finding:
        """Apply equation (20) to power if the motion follows the reference from the same pose."""
        reference = self.follower[match.key]
        usable = comparison.follows & (comparison.t >= 0)
        codes = np.where(usable, comparison.power_codes, 0).astype(np.int8)
        judged = course == "follows" and not match.foreign and not match.displaced
        judged = judged and comparison.power_known >= POWER_KNOWN
        code = sustained(codes, self.rules.frames) if judged else None
        marked = np.flatnonzero(codes == code) if code else np.empty(0, np.int64)
        worst = int(np.argmax(np.abs(np.nan_to_num(comparison.power) * usable))) if len(comparison.t) else 0
        since = interval.start + round(comparison.t[marked[0]] * 1e9) if len(marked) else interval.start
        return Finding(
            interval=interval,
            key=match.key,
            course=course,
            since=since,
            time=now,
            code=code,
            shape=_shape(reference, comparison, usable) if code else {},
            clean=reference.moving if course == "follows" else (),
            off=tuple(np.nanmax(np.abs(comparison.position), axis=0, initial=0.0).tolist()),
            evidence=_evidence(comparison, worst),
        )

    def _resumes(self, interval: Interval) -> bool:
        """True if this interval continues an interrupted motion: a pause, not a fault."""
        doubt = self._doubt
        if doubt is None or doubt.finding.course != "interrupted" or interval.moving != doubt.finding.interval.moving:
            return False
        reference = doubt.reference
        goal = np.asarray(reference.pose) + np.asarray(reference.displacement)
        ways = np.asarray(reference.displacement) * np.asarray(interval.displacement)
        reached = np.asarray(interval.pose) + np.asarray(interval.displacement)
        joints = np.asarray(reference.moving) - 1
        beyond = (reached - goal)[joints] * np.sign(np.asarray(reference.displacement)[joints])
        return bool(np.all(ways[joints] > 0) and np.all(beyond <= self.rules.tolerance.position))

    def _settle(self, interval: Interval, match: Match, trace: Trace) -> list[Finding]:
        """Report joints whose encoder deviated, or showed no motion, in the interval before, as the task continues."""
        doubt, rules, end = self._doubt, self.rules, interval.end
        missed = np.abs(np.subtract(interval.pose, self.follower[match.key].pose))
        if match.skipped == 0 and doubt is not None and not match.foreign:
            # After an interrupted motion, only the joints that start this interval off their goal.
            whole = doubt.finding.course != "interrupted"
            short = [j for j in doubt.joints if whole or missed[j - 1] > rules.tolerance.position]
            verdicts = dict.fromkeys(short, verdict(position_outside=True, power_outside=doubt.power_outside))
            since = doubt.finding.interval.start
            off = replace(doubt.finding, course="deviates", since=since, time=end, verdicts=verdicts)
            return [off] if short else []
        if match.skipped == 1 and self.follower.last is not None:
            key = self.follower.after(self.follower.last)
            reference = self.follower[key]
            still = [j for j in reference.moving if missed[j - 1] > rules.tolerance.position]
            if still:
                agrees = power_agrees(reference, trace, self._last_end, interval.start, rules.tolerance, rules.frames)
                verdicts = dict.fromkeys(still, verdict(position_outside=True, power_outside=not agrees))
                start, largest = interval.start, tuple(missed.tolist())
                return [Finding(interval, key, "deviates", start, end, verdicts=verdicts, off=largest)]
        return []


def _course(
    reference: ReferenceInterval, interval: Interval, trace: Trace, doubtful: tuple[int, ...], rules: Rules
) -> Course:
    """Compare the motion of a closed interval with the reference."""
    if not doubtful:
        return "follows"
    ways = [(interval.displacement[j - 1], reference.displacement[j - 1]) for j in reference.moving]
    shares = np.array([way / expected for way, expected in ways if expected])
    if not len(shares):
        return "other_motion"
    duration = (interval.end - interval.start) * 1e-9
    if abs(duration / reference.duration - 1) > SAME_DURATION and _stretched(reference, interval, trace, rules):
        return "other_speed"
    ended_early = duration < reference.duration - rules.reach
    if ended_early and np.ptp(shares) <= TOGETHER and shares.max(initial=0.0) < 1:
        return "interrupted"
    in_time = abs(duration - reference.duration) <= max(rules.reach * 2, SAME_DURATION * reference.duration)
    others = [j for j in reference.moving if j not in doubtful]
    if (in_time or others) and shares.min() >= WAY[0] and shares.max() <= WAY[1]:
        return "deviates"
    return "other_motion"


def _stretched(reference: ReferenceInterval, interval: Interval, trace: Trace, rules: Rules) -> bool:
    """True if the arm followed the same path, uniformly faster or slower."""
    inside = trace.between(interval.start, interval.end)
    ratio = reference.duration / ((interval.end - interval.start) * 1e-9)
    t = inside.since(interval.start) * ratio
    for joint, pattern in reference.position.items():
        error = outside(inside.position[:, joint - 1], *pattern.envelope(t, rules.reach))
        codes = (np.abs(np.nan_to_num(error)) > rules.tolerance.position).astype(np.int8)
        if sustained(codes, rules.frames):
            return False
    return True


def _shape(reference: ReferenceInterval, comparison: Comparison, usable: NDArray[np.bool_]) -> dict[int, float]:
    """Likeness of the power residual and the speed or position of each moving joint."""
    t = comparison.t[usable]
    residual = np.nan_to_num(comparison.power[usable])
    shape = {}
    for joint, pattern in reference.position.items():
        way = pattern.at(t)
        shape[joint] = likeness(residual, np.gradient(way, t), way) if len(t) > 1 else 0.0
    return shape


def _evidence(comparison: Comparison, worst: int) -> dict[str, float]:
    """The figures behind a finding, with units in their names."""
    if not len(comparison.t):
        return {}
    return {
        "power_residual_W": round(float(np.nan_to_num(comparison.power[worst])), 1),
        "power_limit_W": round(float(comparison.limit[worst]), 1),
        "power_reference_W": round(float(comparison.reference[worst]), 1),
        "seconds_from_onset": round(float(comparison.t[worst]), 2),
    }
