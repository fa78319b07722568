"""The paper's own method on emulated cycles: fixed ±10 %, its two rules, and its network on the table of the task."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from cellwatt.errors import ModelError
from cellwatt_plugins.faults.criteria import Tolerance
from cellwatt_plugins.faults.cycles.findings import CycleFinding, FaultFinding
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.cycles.runs import find_runs
from cellwatt_plugins.faults.paper.codes import Residual
from cellwatt_plugins.faults.paper.expected import ExpectedInterval, Readings, fault_table, resampled
from cellwatt_plugins.faults.paper.judging import Isolation, NamedFault, by_codes, by_encoders, judge_interval
from cellwatt_plugins.faults.paper.network import FaultNetwork, train

AS_IN_THE_PAPER = Tolerance(power=0.10, floor=0.0)
LEAST_WAY = 0.02
"""A joint that goes less far than this, rad, is at rest: no fault shows in it (section IV)."""
AROUND = 0.3
"""s of rest that belong to a cycle on either side."""


def judge_recording_by_paper(
    healthy: Recording,
    healthy_cycles: Sequence[CycleFinding],
    judged: Recording,
    cycles: Sequence[CycleFinding],
    residual: Residual = "samples",
) -> list[CycleFinding]:
    """`cycles` of `judged` with what the paper's method says in place of ours.

    Where cycles begin, which task each is and how fast, is taken from our findings on both recordings: the paper
    leaves that to the robot's controller. Each cycle is held against the learnt speed that is nearest.
    """
    groups: defaultdict[tuple[str, float], list[Readings]] = defaultdict(list)
    for cycle in healthy_cycles:
        if cycle.speed is not None:
            groups[cycle.task, round(cycle.speed, 1)].append(readings_of(healthy, cycle))
    learnt = {key: from_cycles(readings) for key, readings in groups.items()}
    isolate = {key: by_network(expected) for key, expected in learnt.items()}
    out = []
    for cycle in cycles:
        speeds = [speed for task, speed in learnt if task == cycle.task]
        if cycle.speed is None or not speeds:
            out.append(cycle)
            continue
        now = cycle.speed
        nearest = min(speeds, key=lambda speed: abs(speed - now))
        key = (cycle.task, nearest)
        named = judge(learnt[key], readings_of(judged, cycle), isolate[key], AS_IN_THE_PAPER, residual)
        faults = tuple(map(finding_of, named))
        out.append(dataclasses.replace(cycle, status="fault" if faults else "healthy", note="", faults=faults))
    return out


def readings_of(recording: Recording, cycle: CycleFinding) -> Readings:
    """A cycle of a recording in times from its first motion."""
    inside = (recording.time >= cycle.start - AROUND) & (recording.time <= cycle.end + AROUND)
    return Readings(recording.time[inside] - cycle.start, recording.position[inside], recording.power[inside])


def finding_of(fault: NamedFault) -> FaultFinding:
    """The same in the form of `findings.json`."""
    return FaultFinding(fault.joint, fault.kind, fault.intervals, abs(fault.watts), 1.0, fault.alternatives, "")


def from_cycles(cycles: Sequence[Readings]) -> tuple[ExpectedInterval, ...]:
    """Average healthy cycles of one task at one speed and cut the mean where joints start or stop.

    Raises ``ModelError`` if nothing moves.
    """
    t = min(cycles, key=lambda cycle: cycle.t[-1]).t
    seen = [resampled(cycle, t) for cycle in cycles]
    mean = Readings(t, np.mean([each.q for each in seen], axis=0), np.mean([each.power for each in seen], axis=0))
    runs = find_runs(Recording(mean.t, mean.q, mean.power))
    if not runs:
        raise ModelError("nothing moves in the healthy cycles: the paper's method compares intervals of motion")
    return tuple(_interval(number, mean, run.first, run.last) for number, run in enumerate(runs, start=1))


def by_network(expected: Sequence[ExpectedInterval]) -> Isolation:
    """Isolation by the paper's network alone, trained on the table of the task's motion."""
    table = fault_table(expected)
    return _trained(table.shape, table.tobytes()).joints


@lru_cache(maxsize=64)
def _trained(shape: tuple[int, int], content: bytes) -> FaultNetwork:
    return FaultNetwork(train(np.frombuffer(content, np.int8).reshape(shape)))


def _interval(number: int, mean: Readings, first: int, last: int) -> ExpectedInterval:
    part = Readings(mean.t[first : last + 1], mean.q[first : last + 1], mean.power[first : last + 1])
    moving = np.flatnonzero(np.ptp(part.q, axis=0) > LEAST_WAY) + 1
    return ExpectedInterval(number, tuple(moving.tolist()), part)


def judge(
    expected: Sequence[ExpectedInterval],
    cycle: Readings,
    isolate: Isolation,
    tolerance: Tolerance,
    residual: Residual = "samples",
) -> tuple[NamedFault, ...]:
    """Every fault that the paper's method names in a cycle."""
    verdicts = [judge_interval(interval, cycle, tolerance, residual) for interval in expected]
    return by_encoders(verdicts) or by_codes(verdicts, isolate)
