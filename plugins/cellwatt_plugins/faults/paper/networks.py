"""The trained networks of a cell, each for the task at the speed that it was trained for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cellwatt.errors import ModelError
from cellwatt.onnx_file import OnnxFile
from cellwatt_plugins.faults.paper.course import Course, Key, courses_of
from cellwatt_plugins.faults.paper.network import FaultNetwork
from cellwatt_plugins.faults.reference import Reference


def networks_of(path: Path, reference: Reference, where: Path) -> dict[Key, FaultNetwork]:
    """The network in a file, or those in a folder, by task, for a ``reference`` that was read from ``where``.

    Raises ``ModelError`` where there is none, one is of no task of the reference, or two are of the same;
    ``ConfigError`` where a package is missing that it needs.
    """
    courses = courses_of(reference)
    out: dict[Key, FaultNetwork] = {}
    files: dict[Key, Path] = {}
    for file in _files(path):
        network = FaultNetwork(OnnxFile(file))
        fits = [course for course in courses if not network.differs(course)]
        if not fits:
            raise ModelError(_of_no_course(file, network, courses, where))
        for course in fits:
            if course.key in files:
                raise _twice(file, files[course.key], course.key)
            out[course.key], files[course.key] = network, file
    return out


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
