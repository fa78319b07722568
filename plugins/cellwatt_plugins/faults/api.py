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
from cellwatt_plugins.faults.reference import Reference, load, save
from cellwatt_plugins.faults.trace import one_layout, segmented
from cellwatt_plugins.robot.description import packaged, robot_file
from cellwatt_plugins.robot.simulated import is_simulator

if TYPE_CHECKING:
    from cellwatt_plugins.faults.cycles.findings import CycleFinding, Evidence
    from cellwatt_plugins.robot import Arm


@dataclass(frozen=True)
class Learned:
    """A reference, and every task seen in its recordings."""

    reference: Reference
    tasks: tuple[Task, ...]
    note: str | None = None
    """Why the reference has no intervals; None if it has some."""

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
    """Evidence for the cycles of known tasks that were judged by the physics of the arm."""
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
    """Learn a reference from recordings of a healthy robot: tasks, intervals and their power (W).

    ``recordings`` are cellwatt's own or tables with t (s), q_i (rad) and power (W); each task must occur three times
    or more at each speed. ``robot`` is the robot's name, or as for ``Arm.load``: if the description has ``urdf`` and
    ``joints``, whole cycles and the parameters of the arm are learned too. ``meter`` are tables of power on a clock of
    their own, one per table of ``recordings``. ``arm`` is the source with the joints, needed if several sources have
    joints; ``power`` is the power channel. Raises ``RecordingError``, ``ConfigError``, and ``ModelError`` if no task
    recurs.
    """
    name, described = _known(robot)
    if described is not None:
        known = described.description.names, described.body.slides
        blocks = list(frames_of_files(paths_of(recordings), paths_of(meter), *known))
        return _learned_with_cycles(blocks, described, arm, power)
    found, tasks = learn_from(list(frames_of_files(paths_of(recordings), paths_of(meter))), name, arm, power)
    return Learned(found, tuple(tasks))


def faults(
    recordings: Places,
    *,
    reference: Place,
    robot: Place,
    meter: Places = (),
    arm: str | None = None,
    power: str | None = None,
    false_alarms: float = 1e-4,
) -> Judged:
    """Compare every cycle of ``recordings`` with healthy ones: report harmless changes and faulty joints or encoders.

    ``reference`` is a file written by ``Learned.save`` or ``cellwatt reference``, ``robot`` as for ``Arm.load``.
    ``meter`` is as for ``reference``; ``arm`` and ``power`` are those of the reference unless given. ``false_alarms``
    is the accepted share of healthy intervals with a false alarm. Raises ``RecordingError``, ``ConfigError`` and
    ``ModelError``.
    """
    from cellwatt_plugins.faults.cycles.findings import judge_recording
    from cellwatt_plugins.faults.cycles.known import known_of

    file, described = Path(reference), robot_file(robot)
    learnt = load(file)
    known = known_of(learnt, file, described, false_alarms)
    blocks = list(frames_of_files(paths_of(recordings), paths_of(meter), learnt.names))
    recording = recording_of(blocks, learnt.source(one_layout(blocks), arm), power or learnt.power)
    if recording.joints != learnt.joints:
        raise RecordingError(f"the recording has {recording.joints} joints, reference {file} {learnt.joints}")
    evidence: list[Evidence] = []
    found = judge_recording(recording, known, evidence)
    inputs = (*paths_of(recordings), *paths_of(meter), file, described)
    return Judged(tuple(found), recording, tuple(evidence), inputs)


def _learned_with_cycles(blocks: Sequence[Frames], described: Arm, arm: str | None, power: str) -> Learned:
    """Learn whole cycles and the arm's parameters from their power, and intervals if they recur often enough."""
    from cellwatt_plugins.faults.cycles.known import learn_known, stored

    model, cycles = stored(learn_known(recording_of(blocks, arm, power), described), described)
    tasks: list[Task] = []
    note = None
    try:
        learned, tasks = learn_from(blocks, described.name, arm, power)
    except ModelError as error:
        note = f"whole cycles only, no intervals: {error}"
        layout = blocks[0].layout
        source = layout.channels[layout.joints("position", arm)[0]].source
        learned = Reference(1, described.name, source, power, described.joints, ())
    return Learned(replace(learned, power_model=model, cycles=cycles), tuple(tasks), note)


def learn_from(
    blocks: Sequence[Frames], robot: str | None, arm: str | None, power: str
) -> tuple[Reference, list[Task]]:
    """Return the reference learned from ``blocks``, and every task seen in them. Raises ``CellwattError``."""
    layout = one_layout(blocks)
    source = layout.channels[layout.joints("position", arm)[0]].source
    parts = list(segmented(blocks, arm, power))
    trace = joined([part for part, *_ in parts])
    intervals = [interval for _, each, _ in parts for interval in each]
    tasks = [task for *_, each in parts for task in each]
    with stage("learning intervals"):
        learned = learn(layout.step * 1e-9, trace, intervals, tasks)
    return Reference(1, robot, source, power, trace.position.shape[1], learned), tasks


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
