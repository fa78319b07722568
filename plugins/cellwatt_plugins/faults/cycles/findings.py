"""Findings on every cycle of a recording: the content of ``findings.json``."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from cellwatt.arrays import Float
from cellwatt.progress import stage
from cellwatt.scheduler import spread
from cellwatt_plugins.faults.cycles.examine import Verdict, examine
from cellwatt_plugins.faults.cycles.known import Known
from cellwatt_plugins.faults.cycles.match import Match, find_cycles
from cellwatt_plugins.faults.cycles.new_tasks import new_tasks
from cellwatt_plugins.faults.cycles.off_path import STOPPED
from cellwatt_plugins.faults.cycles.pattern import MARGIN, Pattern
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.cycles.runs import Run, find_runs
from cellwatt_plugins.faults.cycles.words import note_on, statement_on
from cellwatt_plugins.travel import travel_text

Kind = Literal["joint", "encoder", "joint_and_encoder"]
Status = Literal["healthy", "changed", "fault", "new_task"]

OFF = 0.3
"""An encoder is off in the moves in which its deviation exceeds this share of its largest deviation."""
SHARE = 0.1
"""A fault shows in the moves in which its power exceeds this share of its largest power."""

MEASURED = 0.8
"""Smallest share of a cycle's samples with power with which the cycle is judged."""
STRANGE = "a task that is not in the reference: learn it from healthy cycles"
NOT_JUDGED = "not judged: power is missing in more than a fifth of the cycle"
TOO_SLOW = "not judged: the power meter has no value of this cycle alone"
KIND_CERTAIN = 0.95
"""Probability below which the kind of fault of a joint off its path is left open."""
CERTAIN = 0.999
"""Smallest probability of a fault that is reported before its cycle is over."""
UNEXPLAINED = 3.0
"""Residual variance relative to the noise above which the explanation of a running cycle is not yet trusted."""


@dataclass(frozen=True)
class FaultFinding:
    """A faulty ``joint`` (1-based; 0 if unknown or one of ``alternatives``): the ``intervals`` (moves of the task, from
    1) in which the fault shows, its largest power ``size_watt``, ``alternatives``: joints that explain the power nearly
    as well; ``or_kind``: the other possible kind if power does not decide it."""

    joint: int
    kind: Kind
    intervals: tuple[int, ...]
    size_watt: float
    confidence: float
    alternatives: tuple[int, ...]
    statement: str
    or_kind: Kind | None = None


@dataclass(frozen=True)
class CycleFinding:
    """A cycle from ``start`` to ``end`` s of the recording; ``speed`` relative to the task's fastest learned speed."""

    start: float
    end: float
    task: str
    speed: float | None
    status: Status
    note: str
    faults: tuple[FaultFinding, ...]

    @property
    def judged(self) -> bool:
        """False if the cycle has too little power to be judged: it shows neither a fault nor that there is none."""
        return self.note not in (NOT_JUDGED, TOO_SLOW)


@dataclass(frozen=True)
class Evidence:
    """The evidence for the finding on a known cycle, at N times ``tau`` s of its healthy pattern.

    ``moves``: start and end of each interval, s of the pattern; ``residual`` (N,) W from healthy power; ``sigma`` (N,)
    W, one standard deviation of healthy cycles; ``explained`` (N,) W, the power of the reported faults.
    """

    finding: CycleFinding
    moves: tuple[tuple[float, float], ...]
    tau: Float
    residual: Float
    sigma: Float
    explained: Float


def judge_recording(recording: Recording, known: Known, evidence: list[Evidence] | None = None) -> list[CycleFinding]:
    """Judge every cycle, in order; cycles of unknown tasks are reported as new. Appends to ``evidence``."""
    recording = replace(recording.in_angles(known.arm.body.levers), meter=known.meter)
    runs = find_runs(recording)
    with stage("finding the cycles"):
        matches = find_cycles(recording, runs, known.patterns)
    judged = list(spread(_judged, matches, "judging cycles", shared=(recording, known)))
    if evidence is not None:
        evidence += [each for _, each in judged if each is not None]
    out = [finding for finding, _ in judged]
    out += [stranger(recording, runs[a : b + 1]) for a, b in new_tasks(runs, matches, known.patterns)]
    return sorted(out, key=lambda finding: finding.start)


def _judged(match: Match, given: tuple[Recording, Known]) -> tuple[CycleFinding, Evidence | None]:
    recording, known = given
    finding, evidence = judge_cycle(recording, match, known)
    finding = replace(finding, start=recording.clock(finding.start), end=recording.clock(finding.end))
    return finding, None if evidence is None else replace(evidence, finding=finding)


def stranger(recording: Recording, runs: Sequence[Run]) -> CycleFinding:
    """Finding on a cycle of an unknown task."""
    start, end = (recording.clock(float(recording.time[k])) for k in (runs[0].first, runs[-1].last))
    return CycleFinding(start, end, "new", None, "new_task", STRANGE, ())


def judge_begun(recording: Recording, match: Match, known: Known) -> CycleFinding:
    """Judge a running known cycle up to its last move seen.

    Only certain faults are reported; the joint, or whether a joint off its path stands still, may remain open. Faults
    other than joints that stand still are not reported while the best explanation leaves too much power unexplained.
    """
    pattern = known.patterns[match.pattern]
    last = int(np.searchsorted([end for _, end in pattern.moves], match.warp.tau[-1] - pattern.step))
    end = pattern.moves[last][1]
    if known.arm.bare and _may_be_interrupted(recording, match, pattern, last):
        return _finding(match, pattern, "", (), end)
    verdict = examine(recording, match, known, end + MARGIN) if _measured(recording, match) >= MEASURED else None
    if verdict is None or _may_be_new(match, verdict):
        return _finding(match, pattern, "", (), end)
    if known.arm.bare and verdict.misfit > UNEXPLAINED and last and not match.odd:
        # A fault that has begun within the cycle explains the last move, not those before it.
        verdict = examine(recording, match, known, end + MARGIN, pattern.moves[last - 1][1]) or verdict
    explained = verdict.misfit <= UNEXPLAINED
    blames = tuple(b for b in verdict.blames if b.what in STOPPED or (explained and b.certainty >= CERTAIN))
    return _finding(match, pattern, "", _faults(recording, match, known, replace(verdict, blames=blames), CERTAIN), end)


def _may_be_interrupted(recording: Recording, match: Match, pattern: Pattern, last: int) -> bool:
    """True if a joint has left its path in the last move alone: the move may go on after a pause.

    The power of a bare arm is too uncertain to decide it.
    """
    before = int(np.searchsorted(pattern.time, pattern.moves[last][0]))
    return any(_deviation(recording, match, pattern, j)[before] <= pattern.limits[j] for j in match.odd)


def _may_be_new(match: Match, verdict: Verdict) -> bool:
    """True if the cycle may belong to a new task that begins like a known one.

    Power cannot decide it for a joint that stands still; the joints that follow the known path can.
    """
    stands = any(joint not in verdict.encoders for joint in match.odd)
    return verdict.foreign > 1.0 - CERTAIN or (stands and match.known < -math.log(1.0 - CERTAIN))


def judge_cycle(recording: Recording, match: Match, known: Known) -> tuple[CycleFinding, Evidence | None]:
    """Judge one known cycle; returns the finding, and its evidence if power was judged."""
    pattern = known.patterns[match.pattern]
    end = pattern.moves[-1][1]
    if _measured(recording, match) < MEASURED:
        return _finding(match, pattern, NOT_JUDGED, (), end), None
    verdict = examine(recording, match, known)
    if verdict is None:
        return _finding(match, pattern, TOO_SLOW, (), end), None
    if verdict.foreign > 0.5:
        found = _finding(match, pattern, STRANGE, (), end)
        return replace(found, task="new", speed=None, status="new_task"), None
    faults = _faults(recording, match, known, verdict, KIND_CERTAIN)
    finding = _finding(match, pattern, note_on(match, verdict), faults, end)
    explained = sum((blame.watts for blame in verdict.blames), start=np.zeros_like(verdict.tau))
    return finding, Evidence(finding, pattern.moves, verdict.tau, verdict.residual, verdict.sigma, explained)


def _measured(recording: Recording, match: Match) -> float:
    """Share of a cycle's samples with power."""
    first, last = np.searchsorted(recording.time, [match.warp.t[0], match.warp.t[-1]])
    return float(np.mean(~np.isnan(recording.power[first : last + 1])))


def _finding(match: Match, pattern: Pattern, note: str, faults: tuple[FaultFinding, ...], end: float) -> CycleFinding:
    """A finding on a cycle up to time ``end`` s of its pattern."""
    status: Status = "fault" if faults else "changed" if note else "healthy"
    start, stop = match.warp.to_recording(np.array([pattern.moves[0][0], end]))
    speed = round(pattern.speed * match.pace, 3)
    return CycleFinding(float(start), float(stop), pattern.task, speed, status, note, faults)


def _faults(
    recording: Recording, match: Match, known: Known, verdict: Verdict, kind_certain: float
) -> tuple[FaultFinding, ...]:
    """The faults of a verdict; the kind of fault of a joint off its path is open below probability ``kind_certain``."""
    pattern, levers = known.patterns[match.pattern], known.arm.body.levers
    blamed = {blame.joint: blame for blame in verdict.blames}
    gone = pattern.time[pattern.time <= verdict.tau[-1]]
    out = []
    for joint in sorted({*blamed, *verdict.encoders}):
        blame, encoder = blamed.get(joint), verdict.encoders.get(joint)
        kind: Kind = "joint" if encoder is None else "encoder" if blame is None else "joint_and_encoder"
        deviation = _deviation(recording, match, pattern, joint)[: len(gone)]
        moves = set() if blame is None else _shows(pattern, verdict.tau, np.abs(blame.watts), SHARE)
        if encoder is not None:
            moves |= _shows(pattern, gone, deviation, OFF)
        watts = 0.0 if blame is None else float(np.abs(blame.watts).max())
        confidence = min(c for c in (encoder, blame.confidence if blame else None) if c is not None)
        stands = encoder if encoder is not None else blame.confidence if blame and blame.what in STOPPED else 1.0
        other: Kind | None = None if stands >= kind_certain else "encoder" if encoder is None else "joint"
        largest = travel_text(float(deviation.max()), float(levers[joint]))
        out.append(
            FaultFinding(
                joint=joint + 1,
                kind=kind,
                intervals=tuple(sorted(moves)),
                size_watt=round(watts, 1),
                confidence=round(confidence, 4),
                alternatives=tuple(j + 1 for j in blame.alternatives) if blame else (),
                statement=statement_on(joint, kind, blame, largest, sorted(moves), other),
                or_kind=other,
            )
        )
    return tuple(out)


def _deviation(recording: Recording, match: Match, pattern: Pattern, joint: int) -> Float:
    """Distance (T,) rad of an encoder from the pattern's path."""
    when = match.warp.to_recording(pattern.time)
    return np.abs(np.interp(when, recording.time, recording.position[:, joint]) - pattern.position[:, joint])


def _shows(pattern: Pattern, tau: Float, size: Float, share: float) -> set[int]:
    """Moves, from 1, in which ``size`` (N,) at pattern times ``tau`` exceeds a share of its maximum."""
    inside = (size[(tau >= start) & (tau <= end)] for start, end in pattern.moves)
    return {move for move, part in enumerate(inside, start=1) if part.max(initial=0.0) > share * size.max()}
