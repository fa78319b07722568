"""``cw.reference`` and ``cw.faults``, the functions behind the commands of the same names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pydantic import BaseModel

from cellwatt.arrays import joined
from cellwatt.config import read_settings
from cellwatt.errors import ModelError, RecordingError
from cellwatt.files import Place, Places, paths_of
from cellwatt.frames import Frames
from cellwatt.progress import stage
from cellwatt.results import Task
from cellwatt_plugins.faults.cycles.recording import Recording, recording_of
from cellwatt_plugins.faults.learn import learn
from cellwatt_plugins.faults.recordings import frames_of_files
from cellwatt_plugins.faults.reference import Reference, TaskReference, load, save
from cellwatt_plugins.faults.trace import one_layout, segmented
from cellwatt_plugins.robot.description import packaged, robot_file
from cellwatt_plugins.robot.simulated import is_simulator
from cellwatt_plugins.travel import levers_of

if TYPE_CHECKING:
    from cellwatt_plugins.faults.cycles.findings import CycleFinding, Evidence
    from cellwatt_plugins.robot import Arm


@dataclass(frozen=True)
class Learned:
    """A reference, and every task seen in its recordings."""

    reference: Reference
    tasks: tuple[Task, ...]
    note: str | None = None
    """Why the reference has no whole cycles, or no intervals for the paper's method; None if it has both."""

    def as_json(self) -> dict[str, Any]:
        """The report of ``cellwatt reference --json``, without the name of the file."""
        cycles = sum(v.cycles for t in self.reference.tasks for v in t.variants)
        meter = self.reference.power_model and self.reference.power_model.meter
        return {
            "robot": self.reference.robot,
            "tasks": [
                {
                    "name": task.name,
                    "signature": task.signature,
                    "variants": [
                        {"speed": v.speed, "cycles": v.cycles, "intervals": len(v.intervals)} for v in task.variants
                    ],
                }
                for task in self.reference.tasks
            ],
            "cycles_left_out": len(self.tasks) - cycles,
            "whole_cycles": [
                {"task": p.task, "moves": len(p.moves), "speed": p.speed, "cycles": p.cycles}
                for p in self.reference.cycles
            ],
            "meter": meter and meter.description,
        }

    def save(self, path: Place) -> None:
        """Write the reference file. Raises ``CellwattError``."""
        save(self.reference, Path(path))


@dataclass(frozen=True)
class Judged:
    """Findings on every cycle of a recording."""

    cycles: tuple[CycleFinding, ...]
    recording: Recording
    evidence: tuple[Evidence, ...] = ()
    """Evidence for the cycles of known tasks."""
    inputs: tuple[Path, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """The content of ``findings.json``, as printed by ``cellwatt faults --json``."""
        return {"cycles": [asdict(finding) for finding in self.cycles]}

    def report(self, path: Place) -> None:
        """Write the HTML report of the cycles. Raises ``CellwattError`` if that fails or plotly is missing."""
        from cellwatt.report import Provenance
        from cellwatt_plugins.faults.report import report

        report(self.cycles, self.evidence, self.recording.joints, Provenance.here(self.inputs)).write(Path(path))


def reference(
    recordings: Places,
    *,
    robot: Place | None = None,
    meter: Places = (),
    arm: str | None = None,
    power: str = "supply.power",
) -> Learned:
    """Learn a reference from recordings of a healthy robot: the cycles of its tasks and their power (W).

    ``recordings`` are cellwatt's own or tables with t (s), q_i (rad) and power (W); each task must occur three times,
    and twice at each speed. ``robot`` is the robot's name, or as for ``Arm.load``: if the description has ``urdf`` and
    ``joints``, the parameters of the arm are learned too. ``meter`` are tables of power on a clock of
    their own, one per table of ``recordings``. ``arm`` is the source with the joints, needed if several sources have
    joints; ``power`` is the power channel. Raises ``RecordingError``, ``ConfigError``, and ``ModelError`` if no task
    recurs.
    """
    name, described = _known(robot)
    joints: tuple[Sequence[str], Sequence[int]] = ((), ())
    if described is not None:
        joints = described.description.names, described.body.slides
    blocks = list(frames_of_files(paths_of(recordings), paths_of(meter), *joints))
    return learn_from(blocks, name, arm, power, described)


def faults(
    recordings: Places,
    *,
    reference: Place,
    robot: Place | None = None,
    meter: Places = (),
    arm: str | None = None,
    power: str | None = None,
    false_alarms: float = 1e-4,
) -> Judged:
    """Compare every cycle of ``recordings`` with healthy ones: report harmless changes and faulty joints or encoders.

    ``reference`` is a file written by ``Learned.save`` or ``cellwatt reference``, ``robot`` as for ``Arm.load``, if the
    reference was learned with it. ``meter`` is as for ``reference``; ``arm`` and ``power`` are those of the reference
    unless given. ``false_alarms`` is the accepted share of healthy intervals with a false alarm. Raises
    ``RecordingError``, ``ConfigError`` and ``ModelError``.
    """
    from cellwatt_plugins.faults.cycles.findings import judge_recording
    from cellwatt_plugins.faults.cycles.known import known_of

    file, described = Path(reference), None if robot is None else robot_file(robot)
    learnt = load(file)
    blocks = list(frames_of_files(paths_of(recordings), paths_of(meter), learnt.names))
    layout = one_layout(blocks)
    source = learnt.source(layout, arm)
    recording = recording_of(blocks, source, power or learnt.power)
    if recording.joints != learnt.joints:
        raise RecordingError(f"the recording has {recording.joints} joints, reference {file} {learnt.joints}")
    levers = levers_of(layout, layout.joints("position", source))
    known = known_of(learnt, file, described, levers, false_alarms)
    evidence: list[Evidence] = []
    found = judge_recording(recording, known, evidence)
    inputs = (*paths_of(recordings), *paths_of(meter), file, *([described] if described else []))
    return Judged(tuple(found), recording, tuple(evidence), inputs)


def learn_from(
    blocks: Sequence[Frames], robot: str | None, arm: str | None, power: str, described: Arm | None = None
) -> Learned:
    """Learn whole cycles of a ``robot``, its parameters if it is ``described``, and intervals if they recur often.

    Without whole cycles, as of a motion without rests, intervals alone are learned for the paper's method, unless the
    robot is described. Raises ``CellwattError``.
    """
    from cellwatt_plugins.faults.cycles.bare_arm import BareArm
    from cellwatt_plugins.faults.cycles.known import learn_known, stored

    layout = one_layout(blocks)
    positions = layout.joints("position", arm)
    subject = described or BareArm(levers_of(layout, positions))
    recording = recording_of(blocks, arm, power)
    source = layout.channels[positions[0]].source
    found = Reference(1, robot, source, power, len(positions), ())
    tasks: tuple[Task, ...] = ()
    note = None
    try:
        model, cycles = stored(learn_known(recording, subject), subject)
        found = replace(found, power_model=model, cycles=cycles)
    except ModelError as error:
        if described is not None:
            raise
        note = f"intervals only, no whole cycles: {error}"
    try:
        learned, tasks = _intervals(blocks, arm, power)
        found = replace(found, tasks=learned)
    except ModelError as error:
        if not found.cycles:
            raise
        note = f"whole cycles only, no intervals: {error}"
    return Learned(found, tasks, note)


def _intervals(
    blocks: Sequence[Frames], arm: str | None, power: str
) -> tuple[tuple[TaskReference, ...], tuple[Task, ...]]:
    """Return the tasks learned by intervals, and every task seen. Raises ``CellwattError``."""
    parts = list(segmented(blocks, arm, power))
    trace = joined([part for part, *_ in parts])
    intervals = [interval for _, each, _ in parts for interval in each]
    tasks = tuple(task for *_, each in parts for task in each)
    with stage("learning intervals"):
        return learn(blocks[0].layout.step * 1e-9, trace, intervals, tasks), tasks


class _Described(BaseModel):
    """The robot's name in a description, and the keys that the model of the arm needs."""

    robot: str
    urdf: Path | None = None
    joints: tuple[Any, ...] = ()


def _known(robot: Place | None) -> tuple[str | None, Arm | None]:
    """Name of a robot, and its arm if it is described so far that whole cycles can be learnt.

    A word that names neither a file or folder nor a packaged robot is only a name. Raises ``ConfigError``.
    """
    if robot is None:
        return None, None
    path = Path(robot)
    if robot == path.stem and robot not in packaged() and not path.exists():
        return robot, None
    if not is_simulator(path):
        described = read_settings(robot_file(robot), _Described)
        if not (described.urdf and described.joints):
            return described.robot, None
    from cellwatt_plugins.robot import Arm

    arm = Arm.load(robot)
    return arm.name, arm
