"""The stage of the paper's method: computes alarms from frames and intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from cellwatt.alarms import AlarmBook
from cellwatt.errors import ModelError
from cellwatt.frames import Frames, Layout
from cellwatt.results import Alarm, Interval, Result
from cellwatt.stage import CellInfo
from cellwatt_plugins.faults.criteria import Tolerance
from cellwatt_plugins.faults.on_reference import ReferenceSettings, ReferenceStage
from cellwatt_plugins.faults.paper.codes import Residual
from cellwatt_plugins.faults.paper.course import Course, Key, courses_of
from cellwatt_plugins.faults.paper.expected import fault_table
from cellwatt_plugins.faults.paper.following import CycleSoFar, CyclesSeen
from cellwatt_plugins.faults.paper.judging import (
    IntervalVerdict,
    NamedFault,
    by_agreement,
    by_codes,
    by_encoders,
    by_network_or_agreement,
)
from cellwatt_plugins.faults.paper.network import FaultNetwork
from cellwatt_plugins.faults.paper.pattern import by_equations
from cellwatt_plugins.faults.trace import Trace, in_angles
from cellwatt_plugins.travel import residual, travel_text

TRAIN = "train it with `cellwatt faults train`"


def networks_of(path: Path, courses: Sequence[Course], where: Path) -> dict[Key, FaultNetwork]:
    """The network in a file, or the networks in a folder, by task; ``courses`` are those of the reference ``where``.

    Raises ``ModelError`` if there is no network, one is for no task of the reference, or two are for one task;
    ``ConfigError`` if a required package is missing.
    """
    files = sorted(path.glob("*.onnx")) if path.is_dir() else [path]
    if not files:
        raise ModelError(f"fault networks {path}: no .onnx file in this folder; make some with `cellwatt faults train`")
    if not courses:
        raise ModelError(f"fault networks {path}: reference {where} has no tasks by intervals to use them for")
    out: dict[Key, FaultNetwork] = {}
    for file in files:
        network = FaultNetwork(file)
        task = network.task
        if task is None:
            raise ModelError(f"fault network {file}: names no task; {TRAIN}")
        fits = [course for course in courses if not task.differs(course)]
        if not fits:
            course = next((c for c in courses if c.key == (task.task, task.speed)), courses[0])
            raise ModelError(
                f"fault network {file}: was trained for {task.task} at speed {task.speed:.2f}, which is none of "
                f"reference {where}: its {course.words} has {task.differs(course)}; {TRAIN}"
            )
        for course in fits:
            if other := out.get(course.key):
                raise ModelError(f"fault network {file}: is for {course.words}, as is {other.path}: keep one of them")
            out[course.key] = network
    return out


_WHAT = {
    "joint": "Joint {joint}: power differs by up to {watts:+.0f} W from healthy cycles: a fault in the joint",
    "encoder": "The encoder of joint {joint} is off by up to {travel}, while power is as in healthy cycles",
    "joint_and_encoder": "Joint {joint} is off its path by up to {travel} and power differs by up to "
    "{watts:+.0f} W: a fault in the joint and in its encoder",
}


class PaperFaultsSettings(ReferenceSettings):
    """Compares whole cycles with healthy ones at equal times, as Sabry et al. do: fixed tolerances, fault tables."""

    tolerance: Tolerance = Tolerance()
    """Largest distance from the reference that counts as healthy."""
    network: Path | None = None
    """Network of a task made by ``cellwatt faults train`` (ONNX), or a folder with several; without it, the joint is
    named by comparison with the motion."""
    equations: Path | None = None
    """Folder made by ``cellwatt train pattern``: power is compared with these equations instead of mean cycles."""
    residual: Residual = "samples"
    """Quantity compared for the codes of intervals: each sample of power, or the interval's energy as in the paper."""


class PaperFaultsStage(ReferenceStage[PaperFaultsSettings]):
    """Raises alarms ``joint_fault``, ``encoder_fault``, ``joint_and_encoder_fault`` after intervals and cycles."""

    Settings = PaperFaultsSettings
    title = "faulty joints and encoders by the method of the paper: fixed tolerances, fault tables"

    def __init__(self, name: str, settings: PaperFaultsSettings, layout: Layout, cell: CellInfo) -> None:
        super().__init__(name, settings, layout, cell)
        courses = courses_of(self._reference)
        if settings.equations:
            courses = by_equations(courses, cell.folder / settings.equations)
        self._following = CyclesSeen(courses, settings.tolerance, len(self._positions), settings.residual)
        networks = networks_of(cell.folder / settings.network, courses, self._path) if settings.network else {}
        self._isolation = {key: by_network_or_agreement(network) for key, network in networks.items()}
        self._book = AlarmBook()

    def process(self, frames: Frames, upstream: Sequence[Result]) -> Sequence[Result]:
        """Return the alarms that changed with this block."""
        found = [r for r in upstream if isinstance(r, Interval) and r.source == self._source]
        block, intervals = in_angles(Trace.of(frames, self._positions, self._power), found, self._levers)
        return [alarm for cycle in self._following.feed(block, intervals) for alarm in self._take(cycle)]

    def _take(self, cycle: CycleSoFar) -> list[Alarm]:
        """Alarms after one more interval: by encoders at once, by codes at the end of the cycle."""
        named = by_encoders(cycle.verdicts)
        if cycle.over and not named:
            course = cycle.course
            isolation = self._isolation.get(course.key) or by_agreement(fault_table(course.intervals))
            named = by_codes(cycle.verdicts, isolation)
        last = cycle.verdicts[-1]
        now = cycle.start + round(last.interval.end * 1e9)
        fresh = [f for f in named if last.interval.number in f.intervals or self._name(f) not in self._book]
        out = [alarm for fault in fresh for alarm in self._book.raise_(self._alarm(fault, cycle, now))]
        if cycle.over:
            still = {self._name(fault) for fault in named}
            text = "Resolved: joint {} did a whole cycle as in the reference, or shows another fault"
            for alarm in [standing.alarm for standing in self._book.raised if standing.alarm.id not in still]:
                out += self._book.clear(alarm.id, now, text.format(alarm.joint))
        return out

    def _name(self, fault: NamedFault) -> str:
        """Id of the alarm about a fault."""
        return f"{self.name}.{self._source}.joint_{fault.joint}.{fault.kind}_fault"

    def _alarm(self, fault: NamedFault, cycle: CycleSoFar, now: int) -> Alarm:
        shown = [v for v in cycle.verdicts if v.interval.number in fault.intervals]
        off, lever = max(each.off_by[fault.joint - 1] for each in shown), float(self._levers[fault.joint - 1])
        evidence = {**_evidence(fault, cycle.course, shown), **residual(off, lever)}
        where = f", in interval {', '.join(map(str, fault.intervals))} of {cycle.course.task}"
        others = f"; it may also be joint {' or '.join(map(str, fault.alternatives))}" if fault.alternatives else ""
        what = _WHAT[fault.kind].format(joint=fault.joint, watts=fault.watts, travel=travel_text(off, lever))
        since = cycle.start + round(shown[0].interval.start * 1e9)
        kind, text = f"{fault.kind}_fault", f"{what}{where}{others}."
        about = fault.joint, fault.alternatives, self._following.latest, evidence
        return Alarm(self._name(fault), kind, "error", True, since, now, text, self._source, *about)


def _evidence(fault: NamedFault, course: Course, shown: Sequence[IntervalVerdict]) -> Mapping[str, Any]:
    """The figures behind a fault, with units in their names."""
    worst = max(shown, key=lambda verdict: abs(verdict.watts))
    return {
        "task": course.task,
        "speed": course.speed,
        "task_interval": shown[-1].interval.number,
        "task_intervals": list(fault.intervals),
        "codes": [verdict.code for verdict in shown],
        "power_residual_W": round(worst.watts, 1),
        "power_limit_W": round(worst.limit, 1),
    }
