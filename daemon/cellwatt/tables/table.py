"""A file as a table: its columns by name and by quantity."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.arrays import Float
from cellwatt.config.wording import did_you_mean
from cellwatt.errors import RecordingError
from cellwatt.tables.names import Name, along, rank, scale, understood, unit_named, units_of, usual
from cellwatt.tables.times import DAY
from cellwatt.tables.unwrap import unwrapped, wraps

ANGLES: Final = ("position", "target_position")
"""Quantities that some devices report modulo a turn."""
FOLLOWED: Final = 0.5
"""Longest time in s between rows of a log in which no joint can turn by half a turn."""
SINCE_1970: Final = (1e9, 4e9)
"""Times since 1970 in s, of the years 2001 to 2096: times without a unit that are such in ms, µs or ns are taken so."""
SHEET_DAYS: Final = (36_526.0, 73_050.0, 25_569.0)
"""Dates of spreadsheets as numbers, in days: of the years 2000 and 2100, and of 1970."""
SHEET_STEP: Final = 2e-4
"""Largest time between rows that marks such dates: 17 s in days, and no step of a table of motion or power in s."""
SHEET_PLACES: Final = 1e5
"""Times that are all multiples of 1/``SHEET_PLACES`` are no such dates, but s of a fast logger."""
WEAK: Final = ("elapsed_time", "seconds", "sec")
"""Names of times that may also be parts of a time of day, or durations, beside a column of times of day."""
MOST_NAMES: Final = 12
"""Largest number of columns that a message lists."""


@dataclass(frozen=True)
class Table:
    """N rows of a file. Columns with known names are given in SI units, others as they are in the file."""

    path: Path
    columns: Mapping[str, Float]
    """(N,) values as in the file, by the file's column name; NaN where a cell is empty."""
    unfit: Mapping[str, str] = field(default_factory=dict)
    """Columns that cannot be read, and the reason: they hold text, or several have the name."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units that the file states separately from the names, by column."""
    rows: NDArray[np.int64] | None = None
    """(N,) number of each row in a text file, from 1; None if rows count from the first value."""
    letters: Mapping[str, str] = field(default_factory=dict)
    """Letters of each column in a spreadsheet."""
    clocks: tuple[str, ...] = ()
    """Columns that hold times of day."""
    named: tuple[str, ...] = ()
    """Names of the joints, in the order of the columns, if the file names them."""
    labels: Mapping[str, str] = field(default_factory=dict)
    """Name of a joint that all cells of a column hold, "" if they differ; for columns of names alone."""
    meant: Mapping[str, Name | None] = field(default_factory=dict)
    """Meaning of columns that name their joint; None for joints that are not the robot's."""

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all columns except the time."""
        return tuple(name for name in (*self.columns, *self.unfit) if name != self.clock)

    @cached_property
    def clock(self) -> str | None:
        """Name of the time column, None if there is none; a single column of times of day may have any name."""
        only = self.clocks[0] if len(self.clocks) == 1 else None
        named = self._whole("time")
        return only if named is None or (only and self._understood[named].family in WEAK) else named

    @cached_property
    def time(self) -> Float:
        """Time (N,) s, from the origin of the file. Raises ``RecordingError`` without a time column."""
        if self.clock is None:
            raise RecordingError(
                f"{self.path}: no column t, timestamp or time for the time; {self.there()}; "
                "--columns 't=YOURS' names yours"
            )
        return self._values(self.clock)

    def rising_time(self, least: int = 2) -> Float:
        """``time``. Raises ``RecordingError`` if it has fewer than ``least`` rows or does not rise with each row."""
        time = self.time
        if len(time) < least:
            raise RecordingError(f"{self.path}: {len(time)} rows, expected at least {least}")
        if not np.all(rises := np.diff(time) > 0):
            row = int(np.argmin(rises))
            raise RecordingError(
                f"{self.path}: column {self.clock} does not rise from {time[row]:g} to {time[row + 1]:g} s "
                f"in {self.place(str(self.clock), row + 1)}"
            )
        return time

    @cached_property
    def row_numbers(self) -> NDArray[np.int64]:
        """Number (N,) of each row in the file, as in a spreadsheet."""
        return np.arange(1, len(self) + 1) if self.rows is None else self.rows

    def row(self, index: int) -> int:
        """Number of a row in the file."""
        return index + 1 if self.rows is None else int(self.rows[index])

    def place(self, name: str, index: int) -> str:
        """Row and column of a cell for a message, as in a spreadsheet."""
        letters = f", column {self.letters[name]}" if name in self.letters else ""
        return f"row {self.row(index)}{letters}"

    def at(self, rows: NDArray[np.bool_] | slice) -> Table:
        """The table restricted to the rows where ``rows`` (N,) is true, or to those of a slice."""
        columns = {name: values[rows] for name, values in self.columns.items()}
        return replace(self, columns=columns, rows=self.row_numbers[rows])

    def joints(self, quantity: str) -> Float | None:
        """A quantity of ``JOINT`` for all n joints in the file, (N, n) in its SI unit; None if the file lacks it.

        Raises ``RecordingError`` if a joint in between is missing, several sources have the quantity, a unit is
        unknown, or a column holds text.
        """
        names = self.joint_names(quantity)
        return np.column_stack([self._values(name) for name in names]) if names else None

    def joint_names(self, quantity: str) -> tuple[str, ...]:
        """Names of the columns of ``joints``, in the order of the joints."""
        family = self._family(quantity)
        if not family:
            return ()
        numbers = range(_first(family), max(family) + 1)
        if missing := [number for number in numbers if number not in family]:
            gone = ", ".join(re.sub(r"\d+(?=\D*$)", str(number), family[max(family)]) for number in missing)
            there = listed([family[number] for number in sorted(family)])
            raise RecordingError(f"{self.path}: no column {gone}; there are {there}")
        return tuple(family[number] for number in numbers)

    def some_joint_names(self, quantity: str, joints: int, like: str) -> tuple[str, ...]:
        """Names of the columns of a quantity for ``joints`` joints: "" for joints without it; () if all lack it.

        If its own numbers do not show whether they begin with 0 or 1, those of the quantity ``like`` decide. Raises
        ``RecordingError`` as ``joints``.
        """
        family = self._family(quantity)
        if not family:
            return ()
        first = _first(family if 0 in family or joints in family else self._family(like))
        return tuple(family.get(first + i, "") for i in range(max(joints, 1 + max(family) - first)))

    def needed(self, quantity: str, joints: int) -> Float:
        """A quantity of the first ``joints`` joints, (N, joints). Raises ``RecordingError`` if one is missing."""
        found = self.joints(quantity)
        if found is None or found.shape[1] < joints:
            first = usual(quantity, 1 if found is None else found.shape[1] + 1)
            raise self.lacks(first if first == usual(quantity, joints) else f"{first} … {usual(quantity, joints)}")
        return found[:, :joints]

    def whole(self, quantity: str) -> Float | None:
        """A quantity of ``WHOLE`` (N,) in its SI unit, None if the file lacks it. Raises ``RecordingError``."""
        name = self._whole(quantity)
        return None if name is None else self._values(name)

    def channel(self, name: str) -> Float | None:
        """Column (N,) of a cell's channel: by its own name, by a name of tables, or by its name after a source.

        None if there is none. Raises ``RecordingError`` if several sources have it.
        """
        if name in self.columns or name in self.unfit:
            return self._values(name)
        if (asked := understood(name)) is not None:
            if asked.number is None:
                return self.whole(asked.quantity)
            family = self._family(asked.quantity)
            number = asked.number - 1 + _first(family)
            return self._values(family[number]) if number in family else None
        found = [each for each in self.columns if each.endswith(f".{name}")]
        if len(found) > 1:
            raise self._several(name, found)
        return self._values(found[0]) if found else None

    def wraps(self, name: str) -> int:
        """Number of jumps by a turn in the angles of a column, which are unwrapped when the column is read."""
        return len(wraps(self._scaled(name))) if self._counted_on(name) else 0

    def along(self, name: str) -> bool | None:
        """True if a column's unit is one of a linear axis (m, N), False for a revolute joint, None without a unit."""
        known = self._understood.get(name)
        return along((known and known.unit) or self.units.get(name))

    def plain(self, name: str) -> Float:
        """Column (N,) by its own name; in the SI unit if the file states its unit separately."""
        unit = unit_named(self.units.get(name, ""))
        return self.columns[name] if unit is None else unit.si(self.columns[name])

    def lacks(self, wanted: str) -> RecordingError:
        """Return the error of a missing column, with the nearest unknown name and a list of the columns."""
        strange = [name for name in self.names if understood(name) is None]
        near = did_you_mean(first := re.split(r"[ ,]", wanted)[0], strange)
        own = re.sub(r"(_\d+)?$", lambda number: "=YOURS{}" if number[0] else "=YOURS", first, count=1)
        return RecordingError(f"{self.path}: no column {wanted}{near}; {self.there()}; --columns '{own}' names yours")

    def there(self) -> str:
        """List the columns for a message."""
        return f"there are: {listed(self.names) or 'none'}"

    @cached_property
    def _found(self) -> Mapping[str, Mapping[str, Mapping[int, str]]]:
        """Columns by quantity, family and joint number; 0 for quantities without a joint."""
        out: dict[str, dict[str, dict[int, str]]] = {}
        for written, name in self._understood.items():
            out.setdefault(name.quantity, {}).setdefault(name.family, {})[name.number or 0] = written
        return out

    @cached_property
    def _understood(self) -> Mapping[str, Name]:
        names = {name: self.meant.get(name, understood(name)) for name in (*self.columns, *self.unfit)}
        return {written: name for written, name in names.items() if name is not None}

    def _family(self, quantity: str) -> Mapping[int, str]:
        """The columns of the preferred family of a quantity, by joint number."""
        families = self._found.get(quantity, {})
        ranked = sorted(families, key=lambda family: rank(quantity, family))
        if not ranked:
            return {}
        if len(ranked) > 1 and rank(quantity, ranked[0]) == rank(quantity, ranked[1]):
            raise self._several(quantity, [next(iter(families[family].values())) for family in ranked])
        family = families[ranked[0]]
        for written, name in self._understood.items():
            same = (name.quantity, name.family) == (quantity, ranked[0])
            if same and (other := family[name.number or 0]) != written:
                raise RecordingError(f"{self.path}: two columns are called {written!r} and {other!r}: keep one")
        return family

    def _whole(self, quantity: str) -> str | None:
        return self._family(quantity).get(0)

    def _several(self, wanted: str, found: list[str]) -> RecordingError:
        return RecordingError(
            f"{self.path}: several sources give {wanted} ({listed(found)}): keep the columns of one arm"
        )

    def _values(self, name: str) -> Float:
        values = self._scaled(name)
        return unwrapped(values) if self._counted_on(name) else values

    def _counted_on(self, name: str) -> bool:
        known = self._understood.get(name)
        return known is not None and known.quantity in ANGLES and not self.along(name) and self._follows_motion

    @cached_property
    def _follows_motion(self) -> bool:
        """True for a log of a motion, false for rows of separate poses: rows far apart in time or without a time."""
        if self.clock is None or self.clock in self.unfit or len(self) < 2:
            return False
        return bool(np.nanmedian(np.diff(self.time)) <= FOLLOWED)

    def _scaled(self, name: str) -> Float:
        if name in self.unfit:
            raise RecordingError(f"{self.path}: column {name} {self.unfit[name]}")
        known = self._understood.get(name)
        if known is None:
            return self.plain(name)
        unit = known.unit or self.units.get(name)
        scaled = scale(known.quantity, unit)
        if scaled is None:
            units = units_of(known.quantity)
            raise RecordingError(f"{self.path}: column {name}: unknown unit {unit!r} (expected {', '.join(units)})")
        values, (factor, offset) = self.columns[name], scaled
        if known.quantity == "time" and unit is None:
            finite = values[np.isfinite(values)]
            middle = float(np.median(finite)) if len(finite) else 0.0
            dated = SHEET_DAYS[0] < middle < SHEET_DAYS[1] and 0 < np.median(np.diff(finite)) < SHEET_STEP
            if dated and not np.allclose(rounded := finite * SHEET_PLACES, np.round(rounded), rtol=0, atol=1e-3):
                return DAY * (values - SHEET_DAYS[2])
            low, high = SINCE_1970
            return values * next((each for each in (1e-3, 1e-6, 1e-9) if low <= middle * each < high), 1.0)
        return values if scaled == (1.0, 0.0) else values * factor + offset


def listed(names: tuple[str, ...] | list[str]) -> str:
    """List names for a message, at most ``MOST_NAMES``."""
    return ", ".join(names[:MOST_NAMES]) + (" …" if len(names) > MOST_NAMES else "")


def _first(family: Mapping[int, str]) -> int:
    return min(1, *family) if family else 1
