"""Counts what was found against what was wrong."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import product

from cellwatt_plugins.faults.cycles.findings import CycleFinding
from faults.bound import THRESHOLD, told_at_best
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
    """Clear faults detected by then: told that there is one which this joint has or may have, of whatever kind."""
    named_alone_in_first_interval: int = 0
    """Those of which the joint, alone, and its kind were told."""
    by_next_interval: int = 0
    told_at_best: float = 0.0
    """Clear faults that the best detector there can be is expected to tell in the first interval."""
    out_of_reach: int = 0
    """Clear faults that it would rather miss than tell."""
    out_of_spread: int = 0
    """The same where harmless changes have no bound."""
    undecided: int = 0
    """Faulty joints off their path of which it was said that power cannot tell the kind: neither isolated nor wrong."""
    cannot_tell: int = 0
    """Cycles with a fault of which it was said that one is there, and not which joint has it."""
    wrong_names: int = 0
    wrong_names_while_running: int = 0
    wrong_kinds_while_running: int = 0
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


def _names(cycles: Sequence[CycleFinding]) -> set[Name]:
    """Joints and kinds that were told; none where it is said that the joint or its kind cannot be told."""
    faults = [fault for cycle in cycles for fault in cycle.faults if fault.or_kind is None and fault.joint]
    return {(fault.joint, kind) for fault in faults for kind in _KINDS[fault.kind]}


def _in_vain(cycles: Sequence[CycleFinding], wanted: set[Name]) -> int:
    """Faults told of joints of which neither the first nor an alternative is faulty; each joint once."""
    faults = [fault for cycle in cycles for fault in cycle.faults]
    right = {joint for joint, _ in wanted}
    return len({(f.joint, f.kind) for f in faults if not right & {f.joint, *f.alternatives}})


def _told_in(
    truth: Truth, mine: Sequence[CycleFinding], at_once: bool, early: Sequence[CycleFinding], alone: bool = False
) -> dict[Name, int]:
    """The move, from 1, at whose end each name was first told; not as one of several where it must be ``alone``.

    Nor then if it was left open whether the joint or its encoder is faulty.
    """
    out: dict[Name, int] = {}
    for cycle, over in (*((cycle, False) for cycle in early), *((cycle, True) for cycle in mine)):
        gone = truth.moves if over else sum(end < cycle.end + LATE for end in truth.ends)
        for fault in cycle.faults:
            if alone and (fault.alternatives or fault.or_kind is not None):
                continue
            move = min(fault.intervals, default=gone) if over and at_once else gone
            names = product((fault.joint, *fault.alternatives), _KINDS[fault.kind])
            out |= {name: min(move, out.get(name, move)) for name in names}
    return out


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
    wanted = {(fault.joint + 1, fault.kind) for fault in truth.plan.faults}
    acts = {
        (fault.joint + 1, fault.kind): move
        for fault, watts, move in zip(truth.plan.faults, truth.watts, truth.first_acts, strict=True)
        if fault.kind == "encoder" or watts >= CLEAR
    }
    clear = set(acts)
    reach = [k for k, fault in enumerate(truth.plan.faults) if (fault.joint + 1, fault.kind) in clear]
    open_kind = {fault.joint for cycle in mine for fault in cycle.faults if fault.or_kind is not None}
    faulty = {joint for joint, _ in wanted}
    # That something is wrong with a joint is told by an alarm of the other kind, too: only the isolation is wrong.
    detected = _by_joint(_told_in(truth, mine, at_once, early))
    isolated = _told_in(truth, mine, at_once, early, alone=True)
    late = [detected[joint] - move for (joint, _), move in acts.items() if joint in detected]
    return Count(
        cycles=1,
        cycles_recognised=bool(mine),
        clear_faults=len(clear),
        isolated=len(named & clear),
        in_first_interval=sum(moves <= 0 for moves in late),
        named_alone_in_first_interval=sum(isolated.get(name, truth.moves + 1) <= move for name, move in acts.items()),
        by_next_interval=sum(moves <= 1 for moves in late),
        told_at_best=sum(told_at_best(truth.signal_to_noise[k]) for k in reach),
        out_of_reach=sum(truth.signal_to_noise[k] < THRESHOLD for k in reach),
        out_of_spread=sum(truth.signal_to_spread[k] < THRESHOLD for k in reach),
        undecided=len(open_kind & faulty),
        cannot_tell=any(not fault.joint for cycle in mine for fault in cycle.faults),
        wrong_names=len(named - wanted) + len(open_kind - faulty),
        wrong_names_while_running=_in_vain(early, wanted),
        wrong_kinds_while_running=len({(j, k) for j, k in _names(early) if j in faulty} - wanted),
        small_faults=len(wanted) - len(clear),
        small_isolated=len((wanted - clear) & named),
    )


def _by_joint(told_in: Mapping[Name, int]) -> dict[int, int]:
    return {joint: min(move for (other, _), move in told_in.items() if other == joint) for joint, _ in told_in}
