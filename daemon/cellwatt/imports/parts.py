"""Files of published data as parts: one repetition or path each, the columns of every source in SI units."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellwatt.channel import Channel
from cellwatt.errors import CellwattError, RecordingError
from cellwatt.imports.column_map import Column, ColumnMap, Source
from cellwatt.tables import listed, read_table

Float = NDArray[np.float64]


@dataclass(frozen=True)
class Samples:
    """Samples of one source in one part: time (N,) s, values (N, channels)."""

    time: Float
    channels: tuple[Channel, ...]
    values: Float


@dataclass(frozen=True)
class Part:
    """One repetition: samples by source."""

    name: str
    sources: Mapping[str, Samples]


def read_parts(path: Path, columns: ColumnMap) -> Iterator[Part]:
    """The parts of a Parquet, CSV or MATLAB file.

    Raises ``RecordingError`` where it cannot be read, or lacks a column that is not optional.
    """
    if columns.layout == "matlab":
        yield from (_part(name, found, columns, path) for name, found in _motions(path, columns))
        return
    table = read_table(path)
    if unfit := [name for name in _wanted(columns) if name in table.unfit]:
        raise table.refused(unfit[0])
    found = table.columns
    if columns.part is None:
        yield _part(path.stem, found, columns, path)
        return
    number = _column(columns.part, found, str(path))
    edges = np.flatnonzero(np.diff(number) != 0) + 1
    for a, b in zip([0, *edges], [*edges, len(number)], strict=True):
        yield _part(f"{columns.part} {number[a]:g}", {n: c[a:b] for n, c in found.items()}, columns, path)


def _wanted(columns: ColumnMap) -> Iterator[str]:
    """Names of the columns that a map reads."""
    if columns.part is not None:
        yield columns.part
    for source in columns.sources.values():
        yield source.time
        for column in source.channels.values():
            for joint in range(columns.joints + 1):
                yield column.column.format(joint)
                yield (column.times or "").format(joint)


def _part(name: str, found: Mapping[str, Float], columns: ColumnMap, path: Path) -> Part:
    place = f"{path}: {name}"
    return Part(name, {key: _samples(source, found, columns.joints, place) for key, source in columns.sources.items()})


def _samples(source: Source, found: Mapping[str, Float], joints: int, place: str) -> Samples:
    time = _column(source.time, found, place).reshape(-1) * source.seconds
    if not len(time) or not (np.isfinite(time).all() and (np.diff(time) > 0).all()):
        raise RecordingError(f"{place}: {source.time} is empty or does not rise: it is no time")
    channels, values = [], []
    for name, column in source.channels.items():
        numbered = range(1, joints + 1) if "{}" in name else [0]
        for i in numbered:
            value = _value(column, i, found, place)
            if value is None:
                continue
            if len(value) != len(time):
                raise RecordingError(f"{place}: {column.column} has {len(value)} rows, {source.time} {len(time)}")
            channels.append(Channel(name.format(i), column.unit))
            values.append(value)
    if not channels:
        raise RecordingError(f"{place}: none of its columns is there")
    return Samples(time, tuple(channels), np.stack(values, axis=1))


def _value(column: Column, joint: int, found: Mapping[str, Float], place: str) -> Float | None:
    """(N,); of a matrix (N, joints) its column of the joint."""
    name = column.column.format(joint)
    if column.optional and name not in found:
        return None
    value = _column(name, found, place)
    if value.ndim == 2:
        if joint > value.shape[1]:
            raise RecordingError(f"{place}: {name} has {value.shape[1]} columns, joint {joint} is asked for")
        value = value[:, max(joint - 1, 0)]
    if column.times is not None:
        value = value * _column(column.times.format(joint), found, place).reshape(-1)
    return np.asarray(value * column.factor, np.float64)


def _column(name: str, found: Mapping[str, Float], place: str) -> Float:
    if name not in found:
        raise RecordingError(f"{place}: no column {name}; there are: {listed(sorted(found))}")
    return found[name]


def _motions(path: Path, columns: ColumnMap) -> Iterator[tuple[str, dict[str, Float]]]:
    """Each structure that the pattern ``part`` leads to, flattened: names with dots, arrays (N,) or (N, k)."""
    root = _matlab(path)
    levels = (columns.part or "").split("/")
    found = [("", root)]
    for level in levels:
        pattern = re.compile(re.escape(level).replace(r"\*", r"\d+"))
        found = [
            (f"{name}/{key}".lstrip("/"), below)
            for name, here in found
            if isinstance(here, dict)
            for key, below in sorted(here.items(), key=lambda item: _natural(item[0]))
            if pattern.fullmatch(key)
        ]
    if not found:
        raise RecordingError(f"{path}: nothing is called {columns.part}; there are: {listed(list(root))}")
    for name, here in found:
        yield name, _flat(here)


def _natural(name: str) -> list[int | str]:
    return [int(each) if each.isdigit() else each for each in re.split(r"(\d+)", name)]


def _flat(tree: Any, before: str = "") -> dict[str, Float]:
    out: dict[str, Float] = {}
    for key, value in tree.items() if isinstance(tree, dict) else ():
        if isinstance(value, dict):
            out |= _flat(value, f"{before}{key}.")
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
            array = np.asarray(value, np.float64)
            out[f"{before}{key}"] = array.reshape(-1) if 1 in array.shape or array.ndim != 2 else array
    return out


def _matlab(path: Path) -> dict[str, Any]:
    """The variables of a MATLAB file: before version 7.3 by scipy, from then on, which is HDF5, by h5py."""
    try:
        with path.open("rb") as file:
            newer = b"MATLAB 7.3" in file.read(128)
        if not newer:
            from scipy.io import loadmat  # with an extra only

            return {k: v for k, v in loadmat(path, simplify_cells=True).items() if not k.startswith("__")}
        import h5py  # type: ignore[import-not-found,unused-ignore]
    except ImportError as error:
        raise CellwattError(f"{path}: reading it needs {error.name}: pip install scipy h5py") from error
    except Exception as error:  # a broken file makes scipy fail in any way
        raise RecordingError(f"{path}: cannot be read as a MATLAB file: {error}") from error
    try:
        with h5py.File(path) as opened:
            return _tree(opened)
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read as a MATLAB file: {error}") from error


def _tree(group: Any) -> dict[str, Any]:
    """HDF5 groups as dicts; MATLAB stores arrays by column, so that they are turned."""
    return {
        key: _tree(value) if hasattr(value, "keys") else np.asarray(value[()]).T
        for key, value in group.items()
        if not key.startswith("#")
    }
