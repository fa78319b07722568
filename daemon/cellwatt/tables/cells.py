"""Cells of a text column as numbers: decimal points or commas, digits in groups, times of day.

pyarrow is imported on first use.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from cellwatt.arrays import Float
from cellwatt.tables import times
from cellwatt.tables.names import is_unit, understood

TEXT: Final = "holds text"
MISSING: Final = (
    *("", "nan", "-nan", "null", "none", "na", "n/a", "<na>", "nat", "1.#ind", "-1.#ind", "1.#qnan", "-1.#qnan"),
    *("---", "----", "-----", "or", "ol"),
    *("#n/a", "#n/a n/a", "#na", "#div/0!", "#value!", "#ref!", "#num!", "#name?", "#null!"),
)
"""Texts that mean a missing value, in small letters: of programs, of meters, and errors of spreadsheets."""

_END: Final = r"(?:[eE][+-]?\d+)?$"
_POINT: Final = rf"^[+-]?(?:\d+\.?\d*|\.\d+){_END}|^(?i:[+-]?inf(?:inity)?)$"
_COMMA: Final = rf"^[+-]?(?:\d+,?\d*|,\d+){_END}"
_POINT_GROUPS: Final = r"^[+-]?[1-9]\d{0,2}(?:\.\d{3})+(?:,\d*)?$"
_COMMA_GROUPS: Final = r"^[+-]?[1-9]\d{0,2}(?:,\d{3})+(?:\.\d*)?$"
_BLANK_GROUPS: Final = r"^[+-]?\d{1,3}(?:[ \x{a0}\x{202f}'’]\d{3})+(?:[.,]\d*)?$"
_LIST: Final = re.compile(r"^\s*(?:\w+\((?:'\w+', *)?)?[\[(]+\s*")
_MEASURE: Final = r"^(?P<number>[+-]?\d+\.?\d*(?:[eE][+-]?\d+)?) ?(?P<unit>[a-zA-Zµ°%]+[/a-z0-9^]*)$"
_TRIMMED: Final = ' \t\u00a0\ufeff"'


@dataclass(frozen=True)
class Cells:
    """Content of a column: ``values``, or the first cell that is not a number and its fault."""

    values: Float | None
    """(N,); NaN where a cell is empty."""
    kind: times.Kind | None = None
    """Kind of dates or times of day, if the cells are such."""
    row: int = 0
    """Index of the first cell that is not a number."""
    fault: str = ""
    """``holds text``, or another reason why the column cannot be read."""
    commas: bool = False
    """True for decimal commas."""
    unit: str = ""
    """Unit behind each number, as in ``0.008 sec``; empty without one."""


def cells_of(column: Any, separator: str) -> Cells:
    """Content of a column (N,) of strings; ``separator`` is the file's."""
    import pyarrow as pa
    import pyarrow.compute as pc

    try:
        return Cells(_values(column))
    except pa.ArrowInvalid:
        pass
    if separator != "," and not pc.any(pc.match_substring(column, ".")).as_py():
        with suppress(pa.ArrowInvalid):  # fast path, if the column holds only plain numbers
            return Cells(_values(pc.replace_substring(column, ",", ".")), commas=True)
    column = pc.utf8_trim(column, characters=_TRIMMED)
    missing = pc.is_in(pc.utf8_lower(column), pa.array(MISSING))
    column = pc.if_else(missing, None, column)
    if column.null_count == len(column):
        return Cells(np.full(len(column), np.nan))
    return _truths(column) or _numbers(column, separator) or _times(column) or _measures(column) or _text(column)


def grouped(column: Any) -> int | None:
    """Index of a cell like ``1.234``, if all cells with a point are such: thousands, if decimals have commas."""
    import pyarrow.compute as pc

    pointed = pc.match_substring(column, ".")
    like = pc.match_substring_regex(column, _POINT_GROUPS)
    if not pc.any(pointed).as_py() or not pc.all(pc.or_(pc.invert(pointed), like)).as_py():
        return None
    return int(pc.index(pointed, True).as_py())


def _values(column: Any) -> Float:
    import pyarrow as pa

    return np.asarray(column.cast(pa.float64()).to_numpy(zero_copy_only=False), np.float64)


def _truths(column: Any) -> Cells | None:
    import pyarrow as pa
    import pyarrow.compute as pc

    lower = pc.utf8_lower(column)
    if not pc.all(pc.is_in(lower, pa.array(["true", "false", None], pa.string()))).as_py():
        return None
    return Cells(_values(pc.equal(lower, "true").cast(pa.uint8())))


def _numbers(column: Any, separator: str) -> Cells | None:
    """Numbers with decimal points or commas; None if a cell is neither."""
    import pyarrow.compute as pc

    def like(pattern: str) -> Any:
        return pc.fill_null(pc.match_substring_regex(column, pattern), True)

    column = pc.replace_substring(column, "\u2212", "-")
    column = pc.if_else(like(_BLANK_GROUPS), pc.replace_substring_regex(column, r"[ \x{a0}\x{202f}'’]", ""), column)
    point, comma, points, commas = like(_POINT), like(_COMMA), like(_POINT_GROUPS), like(_COMMA_GROUPS)
    column = pc.replace_substring_regex(column, r"^\+", "")
    if pc.all(point).as_py():
        return Cells(_values(column))
    if pc.all(comma).as_py():
        with_comma = pc.fill_null(pc.match_substring(column, ","), False)
        if separator == "," and pc.all(pc.or_(pc.invert(with_comma), commas)).as_py():
            fault = "may have decimal commas or digits in groups of three"
            return Cells(None, row=int(pc.index(with_comma, True).as_py()), fault=fault)
        return Cells(_values(pc.replace_substring(column, ",", ".")), commas=True)
    if pc.all(pc.or_(comma, points)).as_py() and pc.any(pc.match_substring(column, ",")).as_py():
        return Cells(_values(pc.replace_substring(pc.replace_substring(column, ".", ""), ",", ".")), commas=True)
    if pc.all(pc.or_(point, commas)).as_py():
        return Cells(_values(pc.replace_substring(column, ",", "")))
    if pc.all(pc.or_(point, comma)).as_py():
        return Cells(None, row=int(pc.index(point, False).as_py()), fault="has decimal points and decimal commas")
    return None


def _times(column: Any) -> Cells | None:
    try:
        found = times.times_of(column)
    except ValueError as error:
        return Cells(None, fault=str(error))
    return None if found is None else Cells(*found)


def _measures(column: Any) -> Cells | None:
    """Numbers with a decimal point, each followed by one unit; None if the cells are others."""
    import pyarrow.compute as pc

    parts = pc.extract_regex(column, _MEASURE)
    units = pc.unique(pc.struct_field(parts, "unit")).drop_null()
    if parts.null_count > column.null_count or len(units) != 1 or not is_unit(units[0].as_py()):
        return None
    return Cells(_values(pc.struct_field(parts, "number")), unit=units[0].as_py())


def listed(names: Sequence[str], columns: Sequence[Any]) -> tuple[list[str], list[Any]]:
    """Add a column for each place in the cells of a text column that hold lists of one length, as ``[0.1, 0.2]``.

    Lists are not read if columns of the file have the names that these would get.
    """
    import pyarrow.compute as pc

    all_names, every = list(names), list(columns)
    known = {(name.quantity, name.family) for name in map(understood, names) if name is not None}
    for name, column in zip(names, columns, strict=True):
        meant = understood(f"{name}[0]")
        there = meant is not None and (meant.quantity, meant.family) in known
        if there or not _LIST.match(first_of(column) or ""):
            continue
        inner = pc.replace_substring_regex(column.combine_chunks(), rf"{_LIST.pattern}|\s*(?:[\])][^\[(]*)?$", "")
        mark = next((each for each in ";," if pc.any(pc.match_substring(inner, each)).as_py()), r"\s")
        parts = pc.split_pattern_regex(inner, rf"\s*{mark}\s*")
        widths = pc.unique(pc.list_value_length(parts)).to_pylist()
        if len(widths) == 1 and widths[0]:
            flat = pc.utf8_trim(parts.flatten(), characters=f"{_TRIMMED}'")
            all_names += [f"{name}[{i}]" for i in range(widths[0])]
            every += [flat[i :: widths[0]] for i in range(widths[0])]
    return all_names, every


def first_of(column: Any) -> Any:
    """The first cell of a column that is not empty, None if all are."""
    import pyarrow.compute as pc

    at = pc.index(pc.is_valid(column), True).as_py()
    return None if at < 0 else column[at].as_py()


def _text(column: Any) -> Cells:
    """The first cell that is neither empty nor a number."""
    import pyarrow.compute as pc

    plain = pc.match_substring_regex(column, "|".join((_POINT, _COMMA, _POINT_GROUPS, _COMMA_GROUPS, _BLANK_GROUPS)))
    odd = pc.fill_null(pc.invert(plain), False)
    row = pc.index(odd if pc.any(odd).as_py() else pc.is_valid(column), True).as_py()
    return Cells(None, row=int(row), fault=TEXT)
