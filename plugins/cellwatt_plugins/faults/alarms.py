"""Raises and clears alarms from findings, so that each says one thing once and goes when it is over."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from cellwatt.results import Alarm, Interval
from cellwatt_plugins.faults.criteria import Verdict
from cellwatt_plugins.faults.follow import Place
from cellwatt_plugins.faults.isolate import Suspect, suspects
from cellwatt_plugins.faults.judge import Finding
from cellwatt_plugins.faults.reference import Reference

UNKNOWN = 3
"""Intervals in a row that are not in the reference before a new task is announced."""

_WHAT = {
    "joint_fault": "Joint {joint} {power}, though it follows its path: a fault in the joint or a load on it",
    "encoder_fault": "The encoder of joint {joint} is off by up to {degrees}, while power is as in healthy cycles",
    "joint_and_encoder_fault": "Joint {joint} is off its path by up to {degrees} and power differs too: "
    "a fault in the joint, and possibly in its encoder",
}


@dataclass(slots=True)
class _Raised:
    """An alarm that is up; ``clean`` intervals in which its joint moved without a deviation since."""

    alarm: Alarm
    clean: int = 0


@dataclass
class AlarmBook:
    """The alarms of one arm; ``prefix`` starts their ids, ``clear_after`` clean intervals clear one."""

    prefix: str
    source: str
    reference: Reference
    clear_after: int = 3
    _codes: dict[Place, Finding] = field(default_factory=dict)
    _up: dict[tuple[int, str], _Raised] = field(default_factory=dict)
    _said: set[str] = field(default_factory=set)
    _notice: Alarm | None = None
    _unknown: int = 0

    def take(self, finding: Finding, *, final: bool) -> list[Alarm]:
        """Alarms that change with one more finding; ``final`` is false while its interval still runs."""
        if finding.place is None:
            self._unknown += 1
            if self._unknown >= UNKNOWN:
                return self._say("new_task", finding, "The arm does a task that is not in the reference; it is not judged")
            return []
        self._unknown = 0
        out: list[Alarm] = []
        if finding.course == "other_speed":
            task = self.reference.tasks[finding.place.task].name
            text = f"{task} runs at a speed that is not in the reference; it is not judged at this speed"
            return self._say("new_speed", finding, text)
        if final and finding.course == "follows":
            out += self._known_again(finding)
        for joint, verdict in finding.verdicts.items():
            out += self._encoder(joint, verdict, finding)
        if finding.code is not None:
            self._codes[finding.place] = finding
            out += self._joints(finding)
        if final:
            out += self._count_clean(finding)
        return out

    def _encoder(self, joint: int, verdict: Verdict, finding: Finding) -> list[Alarm]:
        """An encoder that deviates; once power has differed too, the stronger verdict stays."""
        both = self._up.get((joint, "joint_and_encoder_fault"))
        if verdict == "encoder_fault" and both is not None:
            both.clean = 0
            return []
        out: list[Alarm] = []
        if verdict == "joint_and_encoder_fault" and (joint, "encoder_fault") in self._up:
            out.append(self._clear(joint, "encoder_fault", finding, f"Joint {joint}: power differs too, see its new alarm"))
        return [*out, *self._raise(joint, verdict, finding, ())]

    def _joints(self, finding: Finding) -> list[Alarm]:
        """Joint faults that the codes of this task's intervals speak for, raised; those explained away, cleared."""
        if not finding.code:
            return []
        out: list[Alarm] = []
        names = set()
        for suspect in self._blamed(finding):
            joint, alternatives = self._named(suspect)
            names.add(joint)
            if joint in self._moving(finding):
                out += self._raise(joint, "joint_fault", finding, alternatives, suspect.score)
        for joint, kind in list(self._up):
            if kind == "joint_fault" and joint not in names:
                text = f"Joint {joint} is cleared: joint {min(names)} explains its deviations better"
                out.append(self._clear(joint, kind, finding, text))
        return out

    def _named(self, suspect: Suspect) -> tuple[int, tuple[int, ...]]:
        """The joint to name and its alternatives: among equals, the one whose alarm is up stays."""
        equals = (suspect.joint, *suspect.alternatives)
        joint = next((j for j in equals if (j, "joint_fault") in self._up), suspect.joint)
        return joint, tuple(sorted(j for j in equals if j != joint))

    def _blamed(self, finding: Finding) -> list[Suspect]:
        """The joints that explain the newest codes of the task's intervals, since the first that deviates."""
        assert finding.place is not None
        places = [p for p in self._codes if p.task == finding.place.task]
        begun = min((self._codes[p].interval.start for p in places if self._codes[p].code), default=0)
        places = [p for p in places if self._codes[p].interval.start >= begun]
        codes = np.array([self._codes[p].code for p in places], dtype=np.int8)
        moving = np.zeros((len(places), self.reference.joints), dtype=np.int8)
        shape = np.zeros(self.reference.joints)
        for row, place in enumerate(places):
            moving[row, np.asarray(self._interval(place)) - 1] = 1
        for joint, value in finding.shape.items():
            shape[joint - 1] = value
        return list(suspects(codes, moving, shape))

    def _interval(self, place: Place) -> tuple[int, ...]:
        return self.reference.tasks[place.task].variants[place.variant].intervals[place.index].moving

    def _moving(self, finding: Finding) -> tuple[int, ...]:
        return self._interval(finding.place) if finding.place is not None else ()

    def _raise(
        self, joint: int, kind: str, finding: Finding, alternatives: tuple[int, ...], score: float | None = None
    ) -> list[Alarm]:
        """Raise an alarm, or update it once an interval has given new figures."""
        alarm = self._alarm(joint, kind, finding, alternatives, score)
        raised = self._up.get((joint, kind))
        if raised is None:
            self._up[joint, kind] = _Raised(alarm)
            return [alarm]
        raised.clean = 0
        if raised.alarm.interval == alarm.interval and raised.alarm.alternatives == alternatives:
            return []
        raised.alarm = replace(alarm, since=raised.alarm.since)
        return [raised.alarm]

    def _count_clean(self, finding: Finding) -> list[Alarm]:
        out: list[Alarm] = []
        for (joint, kind), raised in list(self._up.items()):
            clean = finding.code == 0 if kind == "joint_fault" else joint in finding.clean
            if joint not in self._moving(finding) or not clean:
                continue
            raised.clean += 1
            if raised.clean >= self.clear_after and not (kind == "joint_fault" and self._still(joint)):
                text = f"Joint {joint} has moved {raised.clean} times as in healthy cycles: no fault any more"
                out.append(self._clear(joint, kind, finding, text))
        return out

    def _still(self, joint: int) -> bool:
        """Whether some interval in which a joint moves deviated when it last ran."""
        return any(f.code and joint in self._interval(p) for p, f in self._codes.items())

    def _clear(self, joint: int, kind: str, finding: Finding, statement: str) -> Alarm:
        up = self._up.pop((joint, kind)).alarm
        return replace(up, active=False, time=finding.time, statement=statement, interval=finding.interval.number)

    def _say(self, kind: str, finding: Finding, statement: str) -> list[Alarm]:
        """Something worth knowing, once."""
        if kind in self._said:
            return []
        self._said.add(kind)
        self._notice = Alarm(
            id=f"{self.prefix}.{self.source}.{kind}",
            kind=kind,
            severity="info",
            active=True,
            since=finding.since,
            time=finding.time,
            statement=statement,
            source=self.source,
            interval=finding.interval.number,
        )
        return [self._notice]

    def _known_again(self, finding: Finding) -> list[Alarm]:
        """The arm is back in the reference: take the notice down."""
        notice, self._notice = self._notice, None
        if notice is None:
            return []
        return [replace(notice, active=False, time=finding.time, statement="The arm runs as in the reference again")]

    def _alarm(
        self, joint: int, kind: str, finding: Finding, alternatives: tuple[int, ...], score: float | None
    ) -> Alarm:
        place = finding.place
        assert place is not None
        task = self.reference.tasks[place.task]
        evidence: dict[str, Any] = {
            "task": task.name,
            "speed": task.variants[place.variant].speed,
            "task_interval": place.index + 1,
            **finding.evidence,
        }
        if score is not None:
            evidence["score"] = round(score, 2)
        return Alarm(
            id=f"{self.prefix}.{self.source}.joint_{joint}.{kind}",
            kind=kind,
            severity="error",
            active=True,
            since=finding.since,
            time=finding.time,
            statement=_statement(joint, kind, alternatives, evidence),
            source=self.source,
            joint=joint,
            alternatives=alternatives,
            interval=finding.interval.number,
            evidence=evidence,
        )


def _statement(joint: int, kind: str, alternatives: tuple[int, ...], evidence: dict[str, Any]) -> str:
    """One plain sentence for the person at the cell."""
    residual = evidence.get("power_residual_W", 0.0)
    more = "more" if residual > 0 else "less"
    power = f"draws {abs(residual):.0f} W {more} than in healthy cycles (limit {evidence.get('power_limit_W', 0.0):.0f} W)"
    degrees = f"{math.degrees(evidence.get('position_residual_rad', 0.0)):.1f}°"
    where = f", in interval {evidence['task_interval']} of {evidence['task']}"
    others = f"; it may as well be joint {' or '.join(map(str, alternatives))}" if alternatives else ""
    return _WHAT[kind].format(joint=joint, power=power, degrees=degrees) + where + others + "."
