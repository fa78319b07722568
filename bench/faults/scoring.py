"""Counts what was found against what was wrong."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

from cellwatt_plugins.faults.cycles.findings import CycleFinding
from faults.cases import Truth

CLEAR = 8.0
"""W that a joint fault must move the power by, for a moment, to count as clear; every encoder fault is."""
LATE = 0.1
"""s by which a move that was found may end before or after the true one."""
_KINDS = {"joint": ("joint",), "encoder": ("encoder",), "joint_and_encoder": ("joint", "encoder")}

Name = tuple[int, str]


@dataclass(frozen=True)
class Count:
    """What was right and wrong, over any number of cycles; names and alarms while a cycle ran count as well."""

    cycles: int = 0
    cycles_recognised: int = 0
    clear_faults: int = 0
    isolated: int = 0
    in_first_interval: int = 0
    named_alone_in_first_interval: int = 0
    by_next_interval: int = 0
    undecided: int = 0
    """Faulty joints off their path of which it was said that power cannot tell the kind: neither isolated nor wrong."""
    wrong_names: int = 0
    wrong_names_while_running: int = 0
    calm_cycles: int = 0
    calm_intervals: int = 0
    false_alarms: int = 0
    false_intervals: int = 0
    small_faults: int = 0
    small_isolated: int = 0
    new_tasks: int = 0
    new_tasks_recognised: int = 0

    def __add__(self, other: Count) -> Count:
        return Count(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


def count(truths: Sequence[Truth], found: Sequence[CycleFinding], early: Sequence[CycleFinding] | None) -> Count:
    """All of one recording; ``early`` is what was said while cycles ran.

    Where it is None, each fault of ``found`` counts as told in the first of its intervals.
    """
    total = Count()
    for truth in truths:
        mine, before = _of(truth, found), _of(truth, early or ())
        if truth.plan.faults:
            total += _faulty(truth, mine, before, early is None)
        else:
            total += _calm(truth, mine, before)
    return total


def _of(truth: Truth, found: Sequence[CycleFinding]) -> list[CycleFinding]:
    return [f for f in found if min(f.end, truth.end) - max(f.start, truth.start) > 0.5 * (f.end - f.start)]


def _names(cycles: Sequence[CycleFinding], others: bool = False) -> set[Name]:
    """Joints and kinds that were told; with the joints said to explain it nearly as well.

    A joint of which it is said that its kind cannot be told is none of them.
    """
    faults = [fault for cycle in cycles for fault in cycle.faults if fault.or_kind is None]
    return {
        (joint, kind)
        for fault in faults
        for joint in (fault.joint, *(fault.alternatives if others else ()))
        for kind in _KINDS[fault.kind]
    }


def _in_vain(cycles: Sequence[CycleFinding], wanted: set[Name]) -> int:
    """Faults told of joints of which neither the first nor an alternative is faulty; each joint once."""
    faults = [fault for cycle in cycles for fault in cycle.faults]
    right = {joint for joint, _ in wanted}
    return len({(f.joint, f.kind) for f in faults if not right & {f.joint, *f.alternatives}})


def _told_in(
    truth: Truth, mine: Sequence[CycleFinding], at_once: bool, early: Sequence[CycleFinding]
) -> dict[Name, int]:
    """The move, from 1, at whose end each name was first told, if only as one of several while the cycle ran."""
    out: dict[Name, int] = {}
    for cycle in early:
        gone = sum(end < cycle.end + LATE for end in truth.ends)
        out |= {name: min(gone, out.get(name, gone)) for name in _names([cycle], others=True)}
    for cycle in mine:
        for fault in (fault for fault in cycle.faults if fault.or_kind is None):
            move = min(fault.intervals, default=truth.moves) if at_once else truth.moves
            out |= {name: out.get(name, move) for name in ((fault.joint, kind) for kind in _KINDS[fault.kind])}
    return out


def _unambiguous(cycle: CycleFinding) -> CycleFinding:
    return replace(cycle, faults=tuple(fault for fault in cycle.faults if not fault.alternatives))


def _calm(truth: Truth, mine: Sequence[CycleFinding], early: Sequence[CycleFinding]) -> Count:
    faults = [fault for cycle in (*mine, *early) for fault in cycle.faults]
    new = truth.plan.task is None
    return Count(
        cycles=1,
        cycles_recognised=bool(mine),
        calm_cycles=1,
        calm_intervals=truth.moves,
        false_alarms=bool(faults),
        false_intervals=len({move for fault in faults for move in fault.intervals}),
        new_tasks=new,
        new_tasks_recognised=new and any(cycle.status == "new_task" for cycle in mine),
    )


def _faulty(truth: Truth, mine: Sequence[CycleFinding], early: Sequence[CycleFinding], at_once: bool) -> Count:
    named = _names(mine)
    told_in = _told_in(truth, mine, at_once, early)
    alone = _told_in(truth, mine, at_once, [_unambiguous(cycle) for cycle in early])
    wanted = {(fault.joint + 1, fault.kind) for fault in truth.plan.faults}
    clear = {
        (fault.joint + 1, fault.kind): move
        for fault, watts, move in zip(truth.plan.faults, truth.watts, truth.first_acts, strict=True)
        if fault.kind == "encoder" or watts >= CLEAR
    }
    open_kind = {fault.joint for cycle in mine for fault in cycle.faults if fault.or_kind is not None}
    faulty = {joint for joint, _ in wanted}
    late = [told_in[name] - move for name, move in clear.items() if name in told_in]
    return Count(
        cycles=1,
        cycles_recognised=bool(mine),
        clear_faults=len(clear),
        isolated=len(named & set(clear)),
        in_first_interval=sum(moves <= 0 for moves in late),
        named_alone_in_first_interval=sum(alone[name] <= move for name, move in clear.items() if name in alone),
        by_next_interval=sum(moves <= 1 for moves in late),
        undecided=len(open_kind & faulty),
        wrong_names=len(named - wanted) + len(open_kind - faulty),
        wrong_names_while_running=_in_vain(early, wanted),
        small_faults=len(wanted) - len(clear),
        small_isolated=len((wanted - set(clear)) & named),
    )
