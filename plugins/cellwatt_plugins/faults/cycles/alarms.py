"""Alarms from cycles: raised by a cycle with a fault, cleared by healthy cycles."""

from __future__ import annotations

import math
from collections.abc import Iterable
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
            early = [alarm for alarm in self._up if matched and alarm.time > start]
            out = [message for alarm in early for message in self._clear(alarm, start, end, number)]
            alarm = Alarm(new_task, "new_task", "info", True, start, end, text, self.source)
            return out + self._book.raise_(alarm, update=False)
        out = self._book.clear(new_task, end, "Resolved: the arm runs as in the reference again")
        if not cycle.judged:
            return out
        found, others = self._alarms(cycle, epoch), self._up
        out += self._raise(found.values())
        for alarm in others:
            out += [] if alarm.id in found else self._clear(alarm, start, end, number)
        return out

    def take_early(self, cycle: CycleFinding, epoch: int) -> list[Alarm]:
        """Return the alarms that a running cycle raises, without those already active.

        A fault is also taken as already reported if one of its alternatives has an active alarm.
        """
        return self._raise(alarm for alarm in self._alarms(cycle, epoch).values() if not self._is_up(alarm))

    def _is_up(self, alarm: Alarm) -> bool:
        joints = (alarm.joint or 0, *alarm.alternatives)
        return any(self._name(joint, alarm.kind) in self._book for joint in joints)

    def _raise(self, alarms: Iterable[Alarm]) -> list[Alarm]:
        return [message for alarm in alarms for message in self._book.raise_(alarm)]

    def _clear(self, alarm: Alarm, start: int, time: int, number: int) -> list[Alarm]:
        """Clear the alarm of a fault not found in a cycle: at once if raised while it ran, else after some cycles."""
        who = f"joint {alarm.joint}" if alarm.joint else "the arm"
        if alarm.time > start:
            text = f"Withdrawn: the whole cycle is explained without this fault of {who}"
            return self._book.clear(alarm.id, time, text)
        text = f"Resolved: {who} has done {{times}} cycles without this fault, the last is number {number}"
        return self._book.clear(alarm.id, time, text, after=Patience(self.clear_after))

    @property
    def _up(self) -> list[Alarm]:
        return [standing.alarm for standing in self._book.raised]

    def _name(self, joint: int, kind: str) -> str:
        """Id of the alarm about a joint (1-based), or about an unknown joint if ``joint`` is 0."""
        return f"{self.prefix}.{self.source}.{f'joint_{joint}' if joint else 'some_joint'}.{kind}"

    def _alarms(self, cycle: CycleFinding, epoch: int) -> dict[str, Alarm]:
        """The alarms for the faults of a cycle, by id."""
        delay = f" The power meter delays this alarm by {self.behind:.2f} s." if self.behind else ""
        alarms = [
            Alarm(
                id=self._name(fault.joint, f"{fault.kind}_fault"),
                kind=f"{fault.kind}_fault",
                severity="error" if fault.confidence >= SURE else "warning",
                active=True,
                since=epoch + _ns(cycle.start),
                time=epoch + _ns(cycle.end),
                statement=fault.statement + delay,
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


def _ns(seconds: float) -> int:
    return math.floor(seconds * 1e9)
