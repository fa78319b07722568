"""Alarms from intervals: raised by deviations, cleared by healthy intervals of the same joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cellwatt.alarms import AT_ONCE, AlarmBook, Patience
from cellwatt.arrays import Float
from cellwatt.results import Alarm
from cellwatt_plugins.faults.criteria import Verdict
from cellwatt_plugins.faults.intervals.judge import Finding
from cellwatt_plugins.faults.isolate import Suspect, suspects
from cellwatt_plugins.faults.reference import Reference
from cellwatt_plugins.travel import residual, travel_text

PATIENCE = 10
"""Factor on the clean intervals that clear an alarm whose deviating interval has not run again."""
UNKNOWN = 3
"""Consecutive intervals that are not in the reference, after which a new task is reported."""
NOTICES = ("new_speed", "new_task")
"""Kinds of alarms that the arm is not judged."""

_WHAT = {
    "joint_fault": "Joint {joint} {power}, though it follows its path: a fault in the joint or a load on it",
    "encoder_fault": "The encoder of joint {joint} is off by up to {travel}, while power is as in healthy cycles",
    "joint_and_encoder_fault": "Joint {joint} is off its path by up to {travel} and power differs too: "
    "a fault in the joint, and possibly in its encoder",
}


@dataclass
class IntervalAlarms:
    """The alarms of one arm; ids start with ``prefix``, ``clear_after`` clean intervals clear an alarm.

    ``levers`` (n,) are those of ``levers_of``.
    """

    prefix: str
    source: str
    reference: Reference
    levers: Float
    clear_after: int = 3
    _book: AlarmBook = field(default_factory=AlarmBook)
    _codes: dict[tuple[int, int], Finding] = field(default_factory=dict)
    _unknown: int = 0

    def take(self, finding: Finding, *, final: bool) -> list[Alarm]:
        """Return the alarms that change with a finding; ``final`` is false while its interval still runs."""
        out = self._withdraw(finding) if final else []
        if finding.key is None:
            self._unknown += 1
            if self._unknown >= UNKNOWN:
                text = "The arm runs a task that is not in the reference; it is not judged"
                out += self._report("new_task", finding, text)
            return out
        self._unknown = 0
        if finding.course == "other_speed":
            task = self.reference.tasks[finding.key.task].name
            text = f"{task} runs at a speed that is not in the reference; it is not judged at this speed"
            return [*out, *self._report("new_speed", finding, text)]
        if final and finding.course == "follows":
            out += self._known_again(finding)
        for joint, verdict in finding.verdicts.items():
            out += self._encoder(joint, verdict, finding)
        if finding.code is not None:
            self._codes[finding.key.task, finding.key.index] = finding
            out += self._joints(finding)
        if final:
            out += self._count_clean(finding)
        return out

    def _withdraw(self, finding: Finding) -> list[Alarm]:
        """Withdraw the alarms raised during an interval that proves, at its end, to be another motion or speed."""
        if finding.course not in ("other_motion", "other_speed"):
            return []
        interval = finding.interval
        self._codes = {key: f for key, f in self._codes.items() if f.interval.number != interval.number}
        mine = [alarm for alarm in self._up() if alarm.since >= interval.start]
        return self._clear(mine, finding, "Withdrawn: joint {joint} made a motion that is not that of the reference")

    def _encoder(self, joint: int, verdict: Verdict, finding: Finding) -> list[Alarm]:
        """Raise the alarm of a deviating encoder; once power has differed too, the joint-and-encoder alarm stays."""
        both = self._name("joint_and_encoder_fault", joint)
        if verdict == "encoder_fault" and both in self._book:
            return self._book.raise_(self._book[both].alarm, update=False)
        out: list[Alarm] = []
        if verdict == "joint_and_encoder_fault":
            mine = [alarm for alarm in self._up("encoder_fault") if alarm.joint == joint]
            out = self._clear(mine, finding, "Withdrawn: power of joint {joint} differs too, see its new alarm")
        return [*out, *self._raise(joint, verdict, finding, ())]

    def _joints(self, finding: Finding) -> list[Alarm]:
        """Raise the joint faults that explain the codes of this task's intervals; clear those no longer needed."""
        if not finding.code:
            return []
        out: list[Alarm] = []
        names = set()
        for suspect in self._blamed(finding):
            joint, alternatives = self._named(suspect)
            names.add(joint)
            if joint in self._moving(finding):
                out += self._raise(joint, "joint_fault", finding, alternatives, suspect.score)
        others = [alarm for alarm in self._up("joint_fault") if alarm.joint not in names]
        text = f"Withdrawn: joint {min(names, default=0)} explains the deviations of joint {{joint}} better"
        return [*out, *self._clear(others, finding, text)]

    def _named(self, suspect: Suspect) -> tuple[int, tuple[int, ...]]:
        """The joint to name and its alternatives; among equals, a joint whose alarm is active is preferred."""
        equals = (suspect.joint, *suspect.alternatives)
        joint = next((j for j in equals if self._name("joint_fault", j) in self._book), suspect.joint)
        return joint, tuple(sorted(j for j in equals if j != joint))

    def _blamed(self, finding: Finding) -> list[Suspect]:
        """The joints that explain the newest codes of the task's intervals, from the first deviation on."""
        assert finding.key is not None
        known = [f for (task, _), f in self._codes.items() if task == finding.key.task]
        begun = min((f.interval.start for f in known if f.code), default=0)
        known = [f for f in known if f.interval.start >= begun]
        codes = np.array([f.code for f in known], dtype=np.int8)
        moving = np.zeros((len(known), self.reference.joints), dtype=np.int8)
        for row, entry in enumerate(known):
            moving[row, np.asarray(self._moving(entry)) - 1] = 1
        shape = np.zeros(self.reference.joints)
        for joint, value in finding.shape.items():
            shape[joint - 1] = value
        return list(suspects(codes, moving, shape))

    def _moving(self, finding: Finding) -> tuple[int, ...]:
        """The joints that move in the reference interval of a finding."""
        key = finding.key
        if key is None:
            return ()
        return self.reference.tasks[key.task].variants[key.variant].intervals[key.index].moving

    def _raise(
        self, joint: int, kind: str, finding: Finding, alternatives: tuple[int, ...], score: float | None = None
    ) -> list[Alarm]:
        """Raise an alarm, or update its evidence when another interval gives new figures.

        The statement does not change: a spring increases the power in one interval and reduces it in the next.
        """
        assert finding.key is not None
        name, task = self._name(kind, joint), self.reference.tasks[finding.key.task]
        way = finding.off[joint - 1], float(self.levers[joint - 1])
        evidence = {
            "task": task.name,
            "speed": task.variants[finding.key.variant].speed,
            "task_interval": finding.key.index + 1,
            **finding.evidence,
            **residual(*way),
            **({} if score is None else {"score": round(score, 2)}),
        }
        up = self._book[name].alarm if name in self._book else None
        same = up if up and up.alternatives == alternatives else None
        text = same.statement if same else _statement(joint, kind, alternatives, evidence, travel_text(*way))
        number, since, time = finding.interval.number, finding.since, finding.time
        about = self.source, joint, alternatives, number, evidence
        alarm = Alarm(name, kind, "error", True, since, time, text, *about)
        return self._book.raise_(alarm, update=same is None or same.interval != number)

    def _count_clean(self, finding: Finding) -> list[Alarm]:
        """Count an interval without deviation for the alarms of its joints; clear those with enough such intervals."""
        out: list[Alarm] = []
        text = "Resolved: joint {joint} has moved {times} times as in healthy cycles"
        for alarm in self._up():
            by_power = alarm.kind == "joint_fault"
            assert alarm.joint is not None
            clean = finding.code == 0 if by_power else alarm.joint in finding.clean
            if alarm.joint in self._moving(finding) and clean:
                # By power, an interval in which the joint moves may have deviated in its latest run.
                still = by_power and any(f.code and alarm.joint in self._moving(f) for f in self._codes.values())
                patience = self.clear_after * (PATIENCE if still else 1)
                out += self._clear([alarm], finding, text, Patience(patience))
        return out

    def _clear(self, alarms: Sequence[Alarm], finding: Finding, text: str, after: Patience = AT_ONCE) -> list[Alarm]:
        out: list[Alarm] = []
        number = finding.interval.number
        for alarm in alarms:
            words = text.replace("{joint}", str(alarm.joint))
            over = self._book.clear(alarm.id, finding.time, words, after=after, interval=number)
            if over and alarm.kind == "joint_fault" and finding.code == 0:
                self._codes = {k: f for k, f in self._codes.items() if not (f.code and alarm.joint in self._moving(f))}
            out += over
        return out

    def _up(self, *kinds: str) -> list[Alarm]:
        """Active alarms about joints, of the given kinds or of all."""
        up = [standing.alarm for standing in self._book.raised]
        return [alarm for alarm in up if alarm.joint is not None and (not kinds or alarm.kind in kinds)]

    def _name(self, kind: str, joint: int | None = None) -> str:
        """Id of an alarm."""
        about = "" if joint is None else f"joint_{joint}."
        return f"{self.prefix}.{self.source}.{about}{kind}"

    def _report(self, kind: str, finding: Finding, statement: str) -> list[Alarm]:
        """Report that the arm is not judged, once until it is again."""
        number, since, time = finding.interval.number, finding.since, finding.time
        alarm = Alarm(self._name(kind), kind, "info", True, since, time, statement, self.source, interval=number)
        return self._book.raise_(alarm, update=False)

    def _known_again(self, finding: Finding) -> list[Alarm]:
        """Clear the notices, as the arm runs a task of the reference again."""
        text = "Resolved: the arm runs as in the reference again"
        return [a for kind in NOTICES for a in self._book.clear(self._name(kind), finding.time, text)]


def _statement(joint: int, kind: str, alternatives: tuple[int, ...], evidence: dict[str, Any], travel: str) -> str:
    """The statement of an alarm, for the person at the cell."""
    residual = evidence.get("power_residual_W", 0.0)
    more = "more" if residual > 0 else "less"
    power = (
        f"draws {abs(residual):.0f} W {more} than in healthy cycles (limit {evidence.get('power_limit_W', 0.0):.0f} W)"
    )
    where = f", in interval {evidence['task_interval']} of {evidence['task']}"
    others = f"; it may also be joint {' or '.join(map(str, alternatives))}" if alternatives else ""
    return _WHAT[kind].format(joint=joint, power=power, travel=travel) + where + others + "."
