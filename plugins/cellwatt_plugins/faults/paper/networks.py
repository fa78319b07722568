"""The trained networks of a cell, each for the task at the speed that it was trained for."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

from cellwatt.errors import ConfigError, ModelError
from cellwatt.onnx_file import OnnxFile
from cellwatt_plugins.faults.network_file import MOTION
from cellwatt_plugins.faults.paper.course import Course, Key, courses_of
from cellwatt_plugins.faults.paper.network import FaultNetwork
from cellwatt_plugins.faults.reference import Reference

if TYPE_CHECKING:
    from cellwatt_plugins.faults.ann.judging import NetworkJudge


@dataclass(frozen=True)
class Networks:
    """Networks of codes by task, and the judge that has those of whole motions, if there are any."""

    codes: dict[Key, FaultNetwork] = field(default_factory=dict)
    motions: NetworkJudge | None = None


def networks_of(path: Path, reference: Reference, where: Path) -> Networks:
    """The network in a file, or those in a folder, for a ``reference`` that was read from ``where``.

    Raises ``ModelError`` where there is none, one is of no task of the reference, or two are of the same;
    ``ConfigError`` where a package is missing that it needs.
    """
    opened = [(file, OnnxFile(file)) for file in _files(path)]
    motions = [each for each in opened if MOTION in each[1].properties]
    codes = [each for each in opened if MOTION not in each[1].properties]
    return Networks(_codes(codes, courses_of(reference), where), _motions(motions, reference, where))


def _codes(opened: Sequence[tuple[Path, OnnxFile]], courses: Sequence[Course], where: Path) -> dict[Key, FaultNetwork]:
    out: dict[Key, FaultNetwork] = {}
    files: dict[Key, Path] = {}
    for file, content in opened:
        network = FaultNetwork(content)
        fits = [course for course in courses if not network.differs(course)]
        if not fits:
            raise ModelError(_of_no_course(file, network, courses, where))
        for course in fits:
            if course.key in files:
                raise _twice(file, files[course.key], course.key)
            out[course.key], files[course.key] = network, file
    return out


def _motions(opened: Sequence[tuple[Path, OnnxFile]], reference: Reference, where: Path) -> NetworkJudge | None:
    if not opened:
        return None
    try:
        from cellwatt_plugins.faults.ann.judging import NetworkJudge
        from cellwatt_plugins.faults.ann.network import PatternNetwork
        from cellwatt_plugins.faults.cycles.known import stored_patterns
    except ModuleNotFoundError as error:
        raise ConfigError(
            f"fault network {opened[0][0]}: needs the package {error.name}: pip install 'cellwatt[explain]'"
        ) from error
    if reference.power_model is None:
        raise ModelError(
            f"fault network {opened[0][0]}: judges whole cycles, and reference {where} has none: learn it with --robot"
        )
    patterns, _ = stored_patterns(reference.power_model, reference.cycles)
    found: list[PatternNetwork | None] = [None] * len(patterns)
    files: dict[int, Path] = {}
    for file, content in opened:
        network = PatternNetwork(content)
        fits = [k for k, pattern in enumerate(patterns) if not network.differs(pattern)]
        if not fits:
            head = network.head
            meant = [p for p in patterns if (p.task, p.speed) == (head.task, head.speed)] or list(patterns)
            raise ModelError(
                f"fault network {file}: was trained for {head.task} at speed {head.speed:.2f}, which is none of "
                f"reference {where}: its {meant[0].task} at speed {meant[0].speed:.2f} has "
                f"{network.differs(meant[0])}; train it with `cellwatt faults train`"
            )
        for k in fits:
            if k in files:
                raise _twice(file, files[k], (patterns[k].task, patterns[k].speed))
            found[k], files[k] = network, file
    return NetworkJudge(patterns, tuple(found))


def _twice(file: Path, other: Path, key: Key) -> ModelError:
    return ModelError(f"fault network {file}: is for {key[0]} at speed {key[1]:.2f}, as is {other}: keep one of them")


def _files(path: Path) -> list[Path]:
    if not path.is_dir():
        return [path]
    found = sorted(path.glob("*.onnx"))
    if not found:
        raise ModelError(f"fault networks {path}: no .onnx file in this folder; make some with `cellwatt faults train`")
    return found


def _of_no_course(file: Path, network: FaultNetwork, courses: Sequence[Course], reference: Path) -> str:
    """The one line that says what does not fit; of the course that is meant, where the file says which."""
    task = network.task
    meant = [c for c in courses if task is not None and c.key == (task.task, task.speed)]
    meant = meant or [c for c in courses if len(c.intervals) == network.intervals] or list(courses)
    if not meant:
        return f"fault network {file}: reference {reference} has no tasks by intervals to use it for"
    course = meant[0]
    of = f"a table of {network.intervals} intervals that names no task" if task is None else task.words
    return (
        f"fault network {file}: was trained for {of}, which is none of reference {reference}: its {course.task} at "
        f"speed {course.speed:.2f} has {network.differs(course)}; train it with `cellwatt faults train`"
    )
