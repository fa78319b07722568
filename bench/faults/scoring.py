"""Counts what was found against what was wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

from cellwatt_plugins.faults.cycles.findings import CycleFinding
from faults.cases import Truth

CLEAR = 8.0
"""W that a joint fault must move the power by, for a moment, to count as clear; every encoder fault is."""
_KINDS = {"joint": ("joint",), "encoder": ("encoder",), "joint_and_encoder": ("joint", "encoder")}


@dataclass(frozen=True)
class Count:
    """What was right and wrong, over any number of cycles."""

    cycles: int = 0
    cycles_recognised: int = 0
    clear_faults: int = 0
    isolated: int = 0
    wrong_names: int = 0
    calm_cycles: int = 0
    calm_intervals: int = 0
    false_alarms: int = 0
    false_intervals: int = 0
    small_faults: int = 0
    small_isolated: int = 0
    shown_faults: int = 0
    first_interval: int = 0
    new_tasks: int = 0
    new_tasks_recognised: int = 0

    def __add__(self, other: Count) -> Count:
        return Count(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


def count(truths: Sequence[Truth], found: Sequence[CycleFinding]) -> Count:
    """All of one recording."""
    total = Count()
    for truth in truths:
        mine = [f for f in found if min(f.end, truth.end) - max(f.start, truth.start) > 0.5 * (f.end - f.start)]
        total += _faulty(truth, mine) if truth.plan.faults else _calm(truth, mine)
    return total


def _calm(truth: Truth, mine: Sequence[CycleFinding]) -> Count:
    faults = [fault for cycle in mine for fault in cycle.faults]
    new = truth.plan.task is None
    return Count(
        cycles=1,
        cycles_recognised=bool(mine),
        calm_cycles=1,
        calm_intervals=truth.moves,
        false_alarms=bool(faults),
        false_intervals=sum(len(fault.intervals) for fault in faults),
        new_tasks=new,
        new_tasks_recognised=new and any(cycle.status == "new_task" for cycle in mine),
    )


def _faulty(truth: Truth, mine: Sequence[CycleFinding]) -> Count:
    named = {(fault.joint, kind) for cycle in mine for fault in cycle.faults for kind in _KINDS[fault.kind]}
    firsts = {
        (fault.joint, kind): min(fault.intervals, default=0)
        for c in mine
        for fault in c.faults
        for kind in _KINDS[fault.kind]
    }
    wanted = {(fault.joint + 1, fault.kind) for fault in truth.plan.faults}
    clear = {
        (fault.joint + 1, fault.kind): move
        for fault, watts, move in zip(truth.plan.faults, truth.watts, truth.first_acts, strict=True)
        if fault.kind == "encoder" or watts >= CLEAR
    }
    hit = named & set(clear)
    return Count(
        cycles=1,
        cycles_recognised=bool(mine),
        clear_faults=len(clear),
        isolated=len(hit),
        wrong_names=len(named - wanted),
        small_faults=len(wanted) - len(clear),
        small_isolated=len((wanted - set(clear)) & named),
        shown_faults=len(hit),
        first_interval=sum(firsts[name] <= clear[name] for name in hit),
    )
