"""Alarms from cycles: raised by a cycle with a fault, cleared by healthy cycles."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

from cellwatt.alarms import AlarmBook, Patience
from cellwatt.results import Alarm

if TYPE_CHECKING:
    from cellwatt_plugins.faults.cycles.findings import CycleFinding

SURE = 0.8
"""Smallest confidence of an error; below it, the alarm is a warning."""


@dataclass
class CycleAlarms:
    """The alarms of one arm; ids start with ``prefix``, ``clear_after`` cycles without the fault clear an alarm.

    ``behind`` is the delay of alarms due to a slow power meter, s; each alarm states it.
    """

    prefix: str
    source: str
    clear_after: int
    behind: float = 0.0
    _book: AlarmBook = field(default_factory=AlarmBook)

    def take(self, cycle: CycleFinding, number: int, epoch: int, *, matched: bool = True) -> list[Alarm]:
        """Return the alarms that change with the ``number``-th cycle, whose times are in s since ``epoch`` (ns).

        ``matched`` is false for motion that matches no known cycle, as after an aborted one, whose early alarms stay.
        """
        start, end = epoch + _ns(cycle.start), epoch + _ns(cycle.end)
        new_task = f"{self.prefix}.{self.source}.new_task"
        if cycle.status == "new_task":
            text = "The arm runs a task that is not in the reference; it is not judged"
            alarm = Alarm(new_task, "new_task", "info", True, start, end, text, self.source)
            return [*(self._withdraw((), start, end) if matched else ()), *self._book.raise_(alarm, update=False)]
        out = self._book.clear(new_task, end, "Resolved: the arm runs as in the reference again")
        if not cycle.judged:
            return out
        found = self._alarms(cycle, epoch)
        return [
            *out,
            *self._raise(found.values()),
            *self._withdraw(found, start, end),
            *self._clear(found, end, number),
        ]

    def take_early(self, cycle: CycleFinding, epoch: int) -> list[Alarm]:
        """Return the alarms that a running cycle raises, without those already active.

        A fault is also taken as already reported if one of its alternatives has an active alarm.
        """
        return self._raise(alarm for alarm in self._alarms(cycle, epoch).values() if not self._is_up(alarm))

    def _is_up(self, alarm: Alarm) -> bool:
        joints = (alarm.joint or 0, *alarm.alternatives)
        return any(self._name(joint, alarm.kind) in self._book for joint in joints)

    def _raise(self, alarms: Iterable[Alarm]) -> list[Alarm]:
        return [said for alarm in alarms for said in self._book.raise_(alarm)]

    def _withdraw(self, found: Collection[str], start: int, time: int) -> list[Alarm]:
        """Clear the alarms raised while a cycle ran, from ``start`` on, for faults not found in the whole cycle."""
        text = "Withdrawn: the whole cycle is explained without this fault of {}"
        early = [alarm for alarm in self._others(found) if alarm.time > start]
        return [said for alarm in early for said in self._book.clear(alarm.id, time, text.format(_who(alarm)))]

    def _clear(self, found: Collection[str], time: int, number: int) -> list[Alarm]:
        """Count a cycle without the fault for the alarms not in ``found``; clear those with enough such cycles."""
        text, after = (
            "Resolved: {} has done {{times}} cycles without this fault, the last is number {}",
            self.clear_after,
        )
        return [
            said
            for alarm in self._others(found)
            for said in self._book.clear(alarm.id, time, text.format(_who(alarm), number), after=Patience(after))
        ]

    def _others(self, found: Collection[str]) -> list[Alarm]:
        """The active alarms about faults that are not in ``found``."""
        return [standing.alarm for standing in self._book.raised if standing.alarm.id not in found]

    def _name(self, joint: int, kind: str) -> str:
        """Id of the alarm about a joint (1-based), or about an unknown joint if ``joint`` is 0."""
        return f"{self.prefix}.{self.source}.{f'joint_{joint}' if joint else 'some_joint'}.{kind}"

    def _alarms(self, cycle: CycleFinding, epoch: int) -> dict[str, Alarm]:
        """The alarms for the faults of a cycle, by id."""
        alarms = [
            Alarm(
                id=self._name(fault.joint, f"{fault.kind}_fault"),
                kind=f"{fault.kind}_fault",
                severity="error" if fault.confidence >= SURE else "warning",
                active=True,
                since=epoch + _ns(cycle.start),
                time=epoch + _ns(cycle.end),
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
            for fault in cycle.faults
        ]
        return {alarm.id: alarm for alarm in alarms}

    @property
    def _delay(self) -> str:
        return f" The power meter delays this alarm by {self.behind:.2f} s." if self.behind else ""


def _who(alarm: Alarm) -> str:
    return f"joint {alarm.joint}" if alarm.joint else "the arm"


def _ns(seconds: float) -> int:
    return math.floor(seconds * 1e9)
