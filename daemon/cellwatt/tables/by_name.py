"""Columns of named joints (``elbow_joint_position``, ``/joint_states/elbow_joint/effort``), in the robot's order."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, Final

from cellwatt.errors import RecordingError
from cellwatt.logs.log import COMMANDS, alike, natural, numbered, placed
from cellwatt.tables.names import JOINT, Name, parsed, understood, unit_in, unit_named
from cellwatt.tables.table import Table
from cellwatt.units import TABLE

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
_OF_LIST: Final = re.compile(r"(?P<path>.*?)(?:joint_)?names?[_.]?\[?(?P<number>\d+)\]?", re.IGNORECASE)
"""Columns that hold the names of joints, numbered like the columns of their quantities."""
_MOTION: Final = frozenset(JOINT) - {"current", "temperature"}
_NO_POWER: Final = (*_OTHER, "max", "min", "peak", "apparent", "reactive", "rated", "nominal")
"""Words in the name of a column in W that is not the present power."""


def by_name(table: Table, joints: Sequence[str]) -> Table:
    """Understand the columns of named joints as those of ``joints``, or without these, in the order of their numbers.

    A file whose joints are numbered is returned unchanged. Raises ``RecordingError`` if the file has only some of
    ``joints``, several for one of them, or joints that change from row to row.
    """
    known = {column: understood(column) for column in (*table.columns, *table.unfit)}
    found = dict(_of_joints(table, known))
    others = {column: name.quantity for column, name in known.items() if name is not None and column not in found}
    by_number = [column for column, quantity in others.items() if quantity in _MOTION]
    paths: dict[str, list[str]] = {}
    for name in found.values():
        if name.quantity == "position":
            paths.setdefault(name.family, []).append(name.joint)
    if joints:  # other groups are other arms
        paths = {p: own for p, own in paths.items() if any(alike(a, b) for a in own for b in joints)} or paths
    if not paths and not by_number and not {"supply.power", "bus.power"} & set(others.values()):
        return _metered(table)
    if not paths or "position" in others.values():
        return table
    if len(plain := [p for p in paths if p.endswith("/joint_states")]) == 1:  # beside /dynamic_joint_states
        paths = {plain[0]: paths[plain[0]]}
    if len(paths) > 1:
        raise RecordingError(f"{table.path}: positions of joints under {', '.join(paths)}: keep the columns of one")
    ((path, written),) = paths.items()
    own = sorted(written, key=natural)
    in_order = numbered(own)
    if len(own) < 2 or (in_order and not all(map(_NUMBERED_JOINT.fullmatch, own))):
        return table
    matched = [any(alike(a, b) for a in own) for b in joints]
    if joints and not in_order and not any(matched):
        return table
    if joints and (not in_order or all(matched)):
        own = [own[at] for at in placed(table.path, own, joints)]
        if by_number and not in_order and own != (named := [joint for joint in written if joint in own]):
            raise RecordingError(
                f"{table.path}: column {by_number[0]} numbers its joint, while the positions of {', '.join(named)} are "
                "in another order than the robot's joints: name the joints in all columns"
            )
    elif not in_order:
        return replace(table, named=tuple(written))
    number = {joint: i for i, joint in enumerate(own, start=1)}
    meant = {
        column: replace(name, family=name.quantity, number=number[name.joint]) if name.joint in number else None
        for column, name in found.items()
        if name.family == path
    }
    return replace(table, meant=meant, named=tuple(joints) or tuple(own))


def _metered(table: Table) -> Table:
    """Understand the only column in W of a file without joints as the power of the supply, whatever its name."""
    units = {column: table.units.get(column) or unit_in(column) or "" for column in (*table.columns, *table.unfit)}
    powers = [column for column, unit in units.items() if unit_named(unit) in TABLE["power"].values()]
    if len(powers) != 1 or any(word in powers[0].casefold() for word in _NO_POWER):
        return table
    return replace(table, meant={powers[0]: Name("supply.power", "power", None, units[powers[0]])})


def _of_joints(table: Table, known: Mapping[str, Name | None]) -> Iterator[tuple[str, Name]]:
    """Columns that name a joint; the family of their name is the path before it."""
    listed = {}
    for column, label in table.labels.items():
        if (match := _OF_LIST.fullmatch(column)) is not None:
            listed[match["path"].casefold(), int(match["number"])] = label
    for column, name in known.items():
        if name is not None and name.number is not None:
            path = name.family.removesuffix(name.stem)
            of_list = listed.get((path, name.number))
            if of_list == "" and len(listed) > 1:
                raise RecordingError(f"{table.path}: the joint of column {column} changes: write one column per joint")
            if of_list:
                yield column, replace(name, family=path, joint=of_list)
        elif name is None and (of_joint := parsed(column, _of_joint)) is not None:
            yield column, of_joint


def _of_joint(text: str, unit: str | None) -> Name | None:
    match = _OF_JOINT.fullmatch(text)
    if match is None:
        return None
    path, joint = match["path"] or "", match["joint"] or match["last"]
    if any(word in f"{path} {joint}".casefold() for word in _OTHER):
        return None
    return Name(_STEMS[(match["stem"] or match["first"]).casefold()], path, None, unit, joint)


def names_joints(column: str) -> bool:
    """True for a column whose name says that it holds names of joints."""
    return _OF_LIST.fullmatch(column) is not None


def label_of(column: Any) -> str:
    """The text that all cells of a column hold, "" if they differ; empty cells do not count."""
    import pyarrow.compute as pc

    texts = pc.unique(column).drop_null()
    return str(texts[0].as_py()) if len(texts) == 1 else ""
