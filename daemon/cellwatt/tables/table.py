"""A file as a table: its columns by name, and by what they stand for."""

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
from cellwatt.tables.names import Name, along, scale, understood, units_of, usual
from cellwatt.tables.unwrap import unwrapped, wraps
from cellwatt.units import named

ANGLES: Final = ("position", "target_position")
"""Quantities that some devices count modulo a turn."""
FOLLOWED: Final = 0.5
"""s between rows of a log up to which a joint is known not to have turned by half a turn from one row to the next."""
MOST_NAMES: Final = 12
"""Columns that a message lists."""


@dataclass(frozen=True)
class Table:
    """N rows of a file. Columns that the dialect knows are given in SI units, all others as they stand there."""

    path: Path
    columns: Mapping[str, Float]
    """(N,) each as it stands in the file, by its own name; NaN where a cell is empty."""
    unfit: Mapping[str, str] = field(default_factory=dict)
    """Columns that cannot be read, and why: they hold text, or several have the name."""
    units: Mapping[str, str] = field(default_factory=dict)
    """Units that the file states beside the names, by column."""
    rows: NDArray[np.int64] | None = None
    """(N,) number of each row in the file, from 1, where it is a text; None where rows count from the first value."""
    letters: Mapping[str, str] = field(default_factory=dict)
    """What a spreadsheet calls each column."""
    clocks: tuple[str, ...] = ()
    """Columns that hold times of day."""
    named: tuple[str, ...] = ()
    """Names of the joints, in the order of the columns, where the file names them."""

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of all columns beside the time."""
        return tuple(name for name in (*self.columns, *self.unfit) if name != self.clock)

    @cached_property
    def clock(self) -> str | None:
        """Name of the time column, None where there is none; the only one of times of day may have any name."""
        only = self.clocks[0] if len(self.clocks) == 1 else None
        return self._whole("time") or only

    @cached_property
    def time(self) -> Float:
        """Time (N,) s, as the file counts it. Raises ``RecordingError`` where there is none."""
        return self._values(self._clock())

    def _clock(self) -> str:
        if self.clock is None:
            raise RecordingError(f"{self.path}: no column t, timestamp or time for the time; {self.there()}")
        return self.clock

    def rising_time(self, least: int = 2) -> Float:
        """``time``. Raises ``RecordingError`` where it has fewer than ``least`` rows or does not rise in each."""
        time = self.time
        if len(time) < least:
            raise RecordingError(f"{self.path}: {len(time)} rows, expected at least {least}")
        if not np.all(rises := np.diff(time) > 0):
            row = int(np.argmin(rises))
            raise RecordingError(
                f"{self.path}: column {self.clock} does not rise from {time[row]:g} to {time[row + 1]:g} s "
                f"in {self.place(self._clock(), row + 1)}"
            )
        return time

    def row(self, index: int) -> int:
        """Number of a row in the file."""
        return index + 1 if self.rows is None else int(self.rows[index])

    def place(self, name: str, index: int) -> str:
        """A cell for a message, as a spreadsheet shows it."""
        letters = f", column {self.letters[name]}" if name in self.letters else ""
        return f"row {self.row(index)}{letters}"

    def at(self, rows: NDArray[np.bool_]) -> Table:
        """The same with some of its rows (N,)."""
        columns = {name: values[rows] for name, values in self.columns.items()}
        return replace(
            self, columns=columns, rows=np.arange(1, len(rows) + 1)[rows] if self.rows is None else self.rows[rows]
        )

    def joints(self, quantity: str) -> Float | None:
        """A quantity of ``JOINT`` of all n joints that the file has, (N, n) in its SI unit; None where it has none.

        Raises ``RecordingError`` where a joint between them is missing, several sources give the quantity, a unit is
        not known, or a column holds text.
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
        """Names of the columns of a quantity that may lack some of ``joints``: "" for those; () where it lacks all.

        Where its own numbers do not tell whether they begin with 0 or 1, those of the quantity ``like`` do. Raises
        ``RecordingError`` as ``joints``.
        """
        family = self._family(quantity)
        if not family:
            return ()
        first = _first(family if 0 in family or joints in family else self._family(like))
        return tuple(family.get(first + i, "") for i in range(max(joints, 1 + max(family) - first)))

    def needed(self, quantity: str, joints: int) -> Float:
        """``joints`` of the first n joints, (N, n). Raises ``RecordingError`` where one is missing."""
        found = self.joints(quantity)
        if found is None or found.shape[1] < joints:
            first = usual(quantity, 1 if found is None else found.shape[1] + 1)
            raise self.lacks(first if first == usual(quantity, joints) else f"{first} … {usual(quantity, joints)}")
        return found[:, :joints]

    def whole(self, quantity: str) -> Float | None:
        """A quantity of ``WHOLE`` (N,) in its SI unit, None where the file has none. Raises ``RecordingError``."""
        name = self._whole(quantity)
        return None if name is None else self._values(name)

    def channel(self, name: str) -> Float | None:
        """Column (N,) of a cell's channel, under its own name, with a source before it, or as tables name it.

        None where there is none. Raises ``RecordingError`` where several sources give it.
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
        """How often the angles of a column jump by a turn; they are given counted on across it."""
        return len(wraps(self._scaled(name))) if self._counted_on(name) else 0

    def along(self, name: str) -> bool | None:
        """True where the unit stated of a column is a linear axis's (m, N), False a turning one's, None without one."""
        known = self._understood.get(name)
        return along((known and known.unit) or self.units.get(name))

    def plain(self, name: str) -> Float:
        """Column (N,) by its own name; in the SI unit where the file holds its unit beside it."""
        unit = named(self.units.get(name, ""))
        return self.columns[name] if unit is None else unit.si(self.columns[name])

    def lacks(self, wanted: str) -> RecordingError:
        """Return the error of a missing column: it names the nearest that is not understood, and all that there are."""
        strange = [name for name in self.names if understood(name) is None]
        near = did_you_mean(re.split(r"[ ,]", wanted)[0], strange)
        return RecordingError(f"{self.path}: no column {wanted}{near}; {self.there()}")

    def there(self) -> str:
        """The columns for a message."""
        return f"there are: {listed(self.names) or 'none'}"

    @cached_property
    def _found(self) -> Mapping[str, Mapping[str, Mapping[int, str]]]:
        """Columns by quantity, family and joint number, 0 for what belongs to no joint."""
        out: dict[str, dict[str, dict[int, str]]] = {}
        for written, name in self._understood.items():
            out.setdefault(name.quantity, {}).setdefault(name.family, {}).setdefault(name.number or 0, written)
        return out

    def _refuse_twins(self, family: Mapping[int, str]) -> None:
        """Raise ``RecordingError`` where two columns of a family have the same number."""
        same = {(name.quantity, name.family, name.number): written for written, name in self._understood.items()}
        for written in family.values():
            name = self._understood[written]
            if (other := same[name.quantity, name.family, name.number]) != written:
                raise RecordingError(f"{self.path}: two columns are called {written!r} and {other!r}: keep one")

    @cached_property
    def _understood(self) -> Mapping[str, Name]:
        names = {name: understood(name) for name in (*self.columns, *self.unfit)}
        return {written: name for written, name in names.items() if name is not None}

    def _family(self, quantity: str) -> Mapping[int, str]:
        """The columns of the preferred family of a quantity, by joint number."""
        families = self._found.get(quantity, {})
        if not families:
            return {}
        ranked = sorted(families.values(), key=lambda each: self._understood[next(iter(each.values()))].rank)
        first = [self._understood[next(iter(each.values()))].rank for each in ranked[:2]]
        if len(first) > 1 and first[0] == first[1]:
            raise self._several(quantity, [next(iter(each.values())) for each in ranked])
        self._refuse_twins(ranked[0])
        return ranked[0]

    def _whole(self, quantity: str) -> str | None:
        return self._family(quantity).get(0)

    def _several(self, wanted: str, found: list[str]) -> RecordingError:
        return RecordingError(
            f"{self.path}: several sources give {wanted} ({listed(found)}): keep the columns of one arm"
        )

    def refused(self, name: str) -> RecordingError:
        """Return the error of a column in ``unfit``."""
        return RecordingError(f"{self.path}: column {name} {self.unfit[name]}")

    def _values(self, name: str) -> Float:
        values = self._scaled(name)
        return unwrapped(values) if self._counted_on(name) else values

    def _counted_on(self, name: str) -> bool:
        known = self._understood.get(name)
        return known is not None and known.quantity in ANGLES and not self.along(name) and self._follows_motion

    @cached_property
    def _follows_motion(self) -> bool:
        """True of a log of a motion; rows of held poses, further apart or without a time, may lie anywhere."""
        if self.clock is None or self.clock in self.unfit or len(self) < 2:
            return False
        return bool(np.nanmedian(np.diff(self.time)) <= FOLLOWED)

    def _scaled(self, name: str) -> Float:
        if name in self.unfit:
            raise self.refused(name)
        known = self._understood.get(name)
        if known is None:
            return self.plain(name)
        unit = known.unit or self.units.get(name)
        scaled = scale(known.quantity, unit)
        if scaled is None:
            units = units_of(known.quantity)
            raise RecordingError(
                f"{self.path}: column {name}: unknown unit {unit!r}{did_you_mean(unit, units)} "
                f"(expected {', '.join(units)})"
            )
        values, (factor, offset) = self.columns[name], scaled
        return values if scaled == (1.0, 0.0) else values * factor + offset


def listed(names: tuple[str, ...] | list[str], most: int = MOST_NAMES) -> str:
    """Names for a message, cut where they are many."""
    return ", ".join(names[:most]) + (" …" if len(names) > most else "")


def _first(family: Mapping[int, str]) -> int:
    return min(1, *family) if family else 1
