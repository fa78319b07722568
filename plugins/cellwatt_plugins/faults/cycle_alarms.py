"""Alarms from cycles: raised by the cycle in which a fault is found, cleared by healthy ones."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, NamedTuple

from cellwatt.results import Alarm

if TYPE_CHECKING:
    from cellwatt_plugins.faults.cycles.findings import CycleFinding, FaultFinding

SURE = 0.8
"""Confidence from which a fault is an error; below, it is a warning."""


class _Span(NamedTuple):
    """ns."""

    start: int
    end: int


@dataclass
class CycleAlarms:
    """The alarms of one arm; ``prefix`` starts their ids, ``clear_after`` cycles without the fault clear one.

    ``behind`` s is how much later a slow power meter lets faults be told; each alarm says so.
    """

    prefix: str
    source: str
    clear_after: int
    behind: float = 0.0
    _up: dict[tuple[int, str], Alarm] = field(default_factory=dict)
    _clean: dict[tuple[int, str], int] = field(default_factory=dict)
    _early: set[tuple[int, str]] = field(default_factory=set)
    _new: Alarm | None = None

    def take(self, cycle: CycleFinding, number: int, epoch: int) -> list[Alarm]:
        """Alarms that change with the ``number``-th cycle; its times are s since ``epoch`` ns."""
        span = _Span(epoch + _ns(cycle.start), epoch + _ns(cycle.end))
        if cycle.status == "new_task":
            return self._say_new(span)
        out: list[Alarm] = []
        if self._new is not None:
            text = "The arm runs as in the reference again"
            out.append(replace(self._new, active=False, time=span.end, statement=text))
            self._new = None
        found = _by_key(cycle)
        out += [self._raise(key, fault, cycle, span) for key, fault in found.items()]
        out += self._clear(found, span, number)
        self._early.clear()
        return out

    def take_early(self, cycle: CycleFinding, epoch: int) -> list[Alarm]:
        """Alarms that a cycle under way raises: those that are not up yet.

        Where it may as well be a joint whose alarm is up, it is taken for that.
        """
        span = _Span(epoch + _ns(cycle.start), epoch + _ns(cycle.end))
        fresh = {key: fault for key, fault in _by_key(cycle).items() if not self._is_up(key[1], fault)}
        self._early |= set(fresh)
        return [self._raise(key, fault, cycle, span) for key, fault in fresh.items()]

    def _is_up(self, kind: str, fault: FaultFinding) -> bool:
        return any((joint, kind) in self._up for joint in (fault.joint, *fault.alternatives))

    def _raise(self, key: tuple[int, str], fault: FaultFinding, cycle: CycleFinding, span: _Span) -> Alarm:
        """Raise an alarm, or give it the newest figures."""
        since = self._up[key].since if key in self._up else span.start
        self._up[key] = self._alarm(key[1], fault, cycle, _Span(since, span.end))
        self._clean[key] = 0
        return self._up[key]

    def _clear(self, found: Mapping[tuple[int, str], FaultFinding], span: _Span, number: int) -> list[Alarm]:
        out = []
        for key in [key for key in self._up if key not in found]:
            self._clean[key] += 1
            who = f"Joint {key[0]}" if key[0] else "The arm"
            if key in self._early:
                text = f"{who} is cleared: the whole cycle is explained otherwise"
            elif self._clean[key] >= self.clear_after:
                text = f"{who}: {self._clean[key]} cycles without this fault, the last is number {number}"
            else:
                continue
            out.append(replace(self._up.pop(key), active=False, time=span.end, statement=text))
        return out

    def _say_new(self, span: _Span) -> list[Alarm]:
        """A new task, said once until the arm is back in a known one."""
        if self._new is not None:
            return []
        text = "The arm does a task that is not in the reference; it is not judged"
        self._new = Alarm(
            id=f"{self.prefix}.{self.source}.new_task",
            kind="new_task",
            severity="info",
            active=True,
            since=span.start,
            time=span.end,
            statement=text,
            source=self.source,
        )
        return [self._new]

    def _alarm(self, kind: str, fault: FaultFinding, cycle: CycleFinding, span: _Span) -> Alarm:
        return Alarm(
            id=f"{self.prefix}.{self.source}.{f'joint_{fault.joint}' if fault.joint else 'some_joint'}.{kind}",
            kind=kind,
            severity="error" if fault.confidence >= SURE else "warning",
            active=True,
            since=span.start,
            time=span.end,
            statement=fault.statement + self._delay,
            source=self.source,
            joint=fault.joint or None,
            alternatives=fault.alternatives,
            evidence={
                "task": cycle.task,
                "speed": cycle.speed,
                "task_intervals": list(fault.intervals),
                "power_residual_W": fault.size_watt,
                "confidence": fault.confidence,
            }
            | ({} if fault.or_kind is None else {"or_kind": fault.or_kind})
            | ({"power_behind_s": round(self.behind, 3)} if self.behind else {}),
        )

    @property
    def _delay(self) -> str:
        return f" The power meter is behind: this is told {self.behind:.2f} s later." if self.behind else ""


def _by_key(cycle: CycleFinding) -> dict[tuple[int, str], FaultFinding]:
    return {(fault.joint, f"{fault.kind}_fault"): fault for fault in cycle.faults}


def _ns(seconds: float) -> int:
    return math.floor(seconds * 1e9)
