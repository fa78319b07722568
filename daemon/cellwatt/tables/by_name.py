"""Columns of joints that are named, not numbered: ``elbow_joint_position``, ``/joint_states/elbow_joint/effort``."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from cellwatt.errors import RecordingError
from cellwatt.logs.log import COMMANDS, alike, natural, numbered, placed
from cellwatt.tables.cells import TEXT, Cells
from cellwatt.tables.names import JOINT, Name, parsed, understood, unit_in
from cellwatt.tables.table import Table
from cellwatt.units import kind_of

LISTS: Final = ("name", "names", "joint_name", "joint_names")
"""Names of columns that hold the names of joints, numbered like the columns of their quantities."""
MOST_JOINTS: Final = 64
"""Largest number of joints that the rows of a file may name."""
_STEMS: Final = {
    **{stem: quantity for quantity, stems in JOINT.items() for stem in stems},
    "pos": "position",
    "vel": "velocity",
    "acc": "acceleration",
    "eff": "torque",
}
_FIRST: Final = "|".join(sorted(_STEMS, key=len, reverse=True))
_LAST: Final = "|".join(stem for stem in _FIRST.split("|") if not stem.startswith("joint_"))  # ends the joint's name
_OF_JOINT: Final = re.compile(
    rf"(?:(?P<path>.*)/)?(?:(?P<joint>[^/]+?)[/._ ](?P<stem>{_LAST})|(?P<first>{_FIRST})[/._ ](?P<last>[^/]+))",
    re.IGNORECASE,
)
_NUMBERED_JOINT: Final = re.compile(r".*(?:joint|axis|motor|(?<![a-z])[aj])[ _]?\d+(?:_joint)?", re.IGNORECASE)
_OTHER: Final = (*COMMANDS, "error", "limit", "setpoint")
"""Words in the name of a column that is not measured."""
_OF_LIST: Final = re.compile(rf"(?P<path>.*?)(?:{'|'.join(LISTS)})[_.]?\[?(?P<number>\d+)\]?", re.IGNORECASE)


def by_name(table: Table, joints: Sequence[str]) -> Table:
    """Understand the columns of named joints as those of ``joints``, or without these, in the order of their numbers.

    A file whose joints are numbered is returned unchanged. Raises ``RecordingError`` if the file has only some of
    ``joints``, several for one of them, or joints that change from row to row.
    """
    found = dict(_of_joints(table))
    paths: dict[str, list[str]] = {}
    for name in found.values():
        if name.quantity == "position":
            paths.setdefault(name.family, []).append(name.joint)
    if joints:  # other groups are other arms
        paths = {p: own for p, own in paths.items() if any(alike(a, b) for a in own for b in joints)} or paths
    if not paths or (not table.texts and table.has("position")):
        return _metered(table)
    if len(plain := [p for p in paths if p.endswith("/joint_states")]) == 1:  # beside /dynamic_joint_states
        paths = {plain[0]: paths[plain[0]]}
    if len(paths) > 1:
        raise RecordingError(f"{table.path}: positions of joints under {', '.join(paths)}: keep the columns of one")
    ((path, own),) = paths.items()
    own = sorted(own, key=natural)
    in_order = numbered(own)
    if len(own) < 2 or (in_order and not all(map(_NUMBERED_JOINT.fullmatch, own))):
        return table
    if joints and not (in_order and not all(any(alike(a, b) for a in own) for b in joints)):
        if not any(alike(a, b) for a in own for b in joints):
            return table
        own = [own[at] for at in placed(table.path, own, joints)]
    elif not in_order:
        return replace(table, named=tuple(own))
    number = {joint: i for i, joint in enumerate(own, start=1)}
    meant = {
        column: replace(name, family=name.quantity, number=number[name.joint]) if name.joint in number else None
        for column, name in found.items()
        if name.family == path
    }
    return replace(table, meant=meant, named=tuple(joints))


def _metered(table: Table) -> Table:
    """Understand the only column in W of a file without joints as the power of the supply, whatever its name."""
    units = {column: table.units.get(column) or unit_in(column) or "" for column in table.columns}
    powers = [(column, unit) for column, unit in units.items() if kind_of(unit) == "power"]
    known = ("position", "target_position", "supply.power", "bus.power")
    if len(powers) != 1 or any(map(table.has, known)):
        return table
    ((column, unit),) = powers
    return replace(table, meant={column: Name("supply.power", "power", None, unit)})


def _of_joints(table: Table) -> Iterator[tuple[str, Name]]:
    """Columns that name a joint; the family of their name is the path before it."""
    listed = {}
    for column, joint in table.texts.items():
        if (match := _OF_LIST.fullmatch(column)) is not None:
            listed[match["path"].casefold(), int(match["number"])] = joint
    for column in (*table.columns, *table.unfit):
        known = understood(column)
        if known is not None and known.number is not None:
            path = known.family.removesuffix(known.stem)
            of_list = listed.get((path, known.number))
            if of_list == "" and len(listed) > 1:
                raise RecordingError(f"{table.path}: the joint of column {column} changes: write one column per joint")
            if of_list:
                yield column, replace(known, family=path, joint=of_list)
        elif known is None and (name := parsed(column, _of_joint)) is not None:
            yield column, name


def _of_joint(text: str, unit: str | None) -> Name | None:
    match = _OF_JOINT.fullmatch(text)
    if match is None:
        return None
    path, joint = match["path"] or "", match["joint"] or match["last"]
    if any(word in f"{path} {joint}".casefold() for word in _OTHER):
        return None
    return Name(_STEMS[(match["stem"] or match["first"]).casefold()], path, None, unit, joint)


def lists_joints(column: str) -> bool:
    """True for a column whose name says that it holds the name of a numbered joint."""
    return _OF_LIST.fullmatch(column) is not None


def one_text(column: Any) -> str:
    """The text that all cells of a column hold; "" if they differ."""
    import pyarrow.compute as pc

    texts = pc.unique(column).to_pylist()
    return str(texts[0]) if len(texts) == 1 else ""


def widened(
    names: Sequence[str], found: Sequence[Cells], columns: Sequence[Any]
) -> tuple[Sequence[str], Sequence[Cells], Sequence[Any], Any]:
    """Columns per joint for rows that each hold one joint, named in a column; also the rows of the first joint.

    Names, contents and texts of the columns are returned unchanged, and None, if no column names joints, or the joints
    do not have the same times.
    """
    labels = [i for i, name in enumerate(names) if name.casefold() in ("joint", *LISTS) and found[i].fault == TEXT]
    times = [i for i, name in enumerate(names) if (known := understood(name)) and known.quantity == "time"]
    if len(labels) != 1 or not times:
        return names, found, columns, None
    label = np.asarray(columns[labels[0]].to_pylist(), object)
    joints = list(dict.fromkeys(label.tolist()))
    rows = [np.flatnonzero(label == joint) for joint in joints]
    least = min(map(len, rows))
    rows = [each[:least] for each in rows]
    time = found[times[0]].values
    if not 2 <= len(joints) <= MOST_JOINTS or time is None or any(np.any(time[r] != time[rows[0]]) for r in rows):
        return names, found, columns, None
    new: list[tuple[str, Cells, Any]] = []
    for i, (name, cells, column) in enumerate(zip(names, found, columns, strict=True)):
        values = cells.values
        if i != labels[0] and (values is None or all(np.array_equal(values[r], values[rows[0]]) for r in rows)):
            new.append((name, cells if values is None else replace(cells, values=values[rows[0]]), column))
        elif values is not None:
            of_joints = zip(joints, rows, strict=True)
            new += [(f"{joint}/{name}", replace(cells, values=values[own]), column) for joint, own in of_joints]
    return *map(list, zip(*new, strict=True)), rows[0]  # type: ignore[return-value]
