"""Dates and times of day in cells, as spreadsheets, loggers and locales write them."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from datetime import date
from typing import Any, Final, Literal

import numpy as np

from cellwatt.arrays import Float

Kind = Literal["date", "clock", "moment"]
"""A day, a time of day, or both."""

CLOCKS: Final = ("clock", "moment")
"""Kinds with a time of day."""
DAY: Final = 86_400.0
HOUR: Final = 3_600.0
EPOCH: Final = date(1970, 1, 1).toordinal()
_TIME: Final = re.compile(
    r"(?:(?P<days>\d+) days?,? )?(?:(?P<date>\d{1,4}(?P<mark>[-./])\d{1,2}(?P=mark)\d{1,4})\.?)?"
    r"(?:(?:(?<=\d)[T ,]\s*|^|(?<=[sy,] ))(?P<hour>\d{1,2}):(?P<minute>\d{2})(?::(?P<second>\d{2}))?"
    r"(?:(?:[.,]|:(?=\d{3}))(?P<fraction>\d{1,12}))?\s*(?P<half>[AaPp]\.?[Mm]\.?)?\s*(?P<zone>Z|UTC|[+-]\d{2}:?\d{2})?)?"
)


_MONTHS: Final = ("jan", "feb", "mar", "apr", "may", "jun", "jul", "aug", "sep", "oct", "nov", "dec")
_IN_WORDS: Final = re.compile(rf"(\d{{1,2}})[-/ ]({'|'.join(_MONTHS)})[a-z]*[-/ ](\d{{4}})", re.IGNORECASE)


def times_of(column: Any) -> tuple[Float, Kind] | None:
    """Parse the times of a column of strings; None if a cell is not a time.

    Times (N,) are in s since 1970 UTC (assumed for cells without a zone), or since midnight; NaN for empty cells.
    Raises ``ValueError`` if day and month cannot be distinguished.
    """
    import pyarrow as pa

    first = next(cell.as_py() for cell in column if cell.is_valid)
    if _IN_WORDS.match(first):
        column = pa.array([None if text is None else _IN_WORDS.sub(_in_numbers, text) for text in column.to_pylist()])
        first = _IN_WORDS.sub(_in_numbers, first)
    match = _TIME.fullmatch(first)
    if not first or match is None:
        return None
    if match["date"] and match["hour"]:
        try:
            moments = column.cast(pa.timestamp("ns"))
            ns = np.asarray(moments.cast(pa.int64()).to_numpy(zero_copy_only=False), np.float64)
            return 1e-9 * ns, "moment"
        except pa.ArrowInvalid:
            pass
    matches = [None if text is None else _TIME.fullmatch(text) for text in column.to_pylist()]
    kinds = {(m["date"] is not None, m["hour"] is not None) for m in matches if m is not None}
    if len(kinds) > 1 or sum(m is not None for m in matches) + column.null_count < len(column):
        return None
    ((dated, timed),) = kinds
    seconds = _days(matches) if dated else np.zeros(len(matches))
    if seconds is None:
        return None
    if timed:
        seconds = seconds + np.array([np.nan if m is None else _of_day(m) for m in matches])
    if not dated:
        short = all(match is None or _is_short(match) for match in matches)
        return unwrapped(seconds, HOUR if short else DAY), "clock"
    return seconds, "moment" if timed else "date"


def _in_numbers(match: re.Match[str]) -> str:
    return f"{match[3]}-{_MONTHS.index(match[2].casefold()) + 1:02}-{int(match[1]):02}"


def unwrapped(seconds: Float, period: float) -> Float:
    """Times (N,) s of a clock that begins anew after ``period`` s, continued past it."""
    known = np.flatnonzero(np.isfinite(seconds))
    past = np.cumsum(np.diff(seconds[known], prepend=seconds[known[:1]]) < -period / 2)
    out = seconds.copy()
    out[known] += period * past
    return out


def _is_short(match: re.Match[str]) -> bool:
    """True for minutes and seconds alone, the short format of spreadsheets."""
    return match["second"] is None and match["fraction"] is not None


def _of_day(match: re.Match[str]) -> float:
    hour, minute, second = int(match["hour"]), int(match["minute"]), match["second"]
    fraction = float(f"0.{match['fraction'] or 0}")
    if _is_short(match):
        return 60.0 * hour + minute + fraction
    if match["half"] is not None:
        hour = hour % 12 + (12 if match["half"][0] in "pP" else 0)
    days = DAY * int(match["days"] or 0)
    return days + 3600.0 * hour + 60.0 * minute + int(second or 0) + fraction - _offset(match["zone"])


def _offset(zone: str | None) -> float:
    digits = re.sub(r"\D", "", zone or "")
    seconds = 3600.0 * int(digits[:2] or 0) + 60.0 * int(digits[2:] or 0)
    return -seconds if zone and zone[0] == "-" else seconds


def _days(matches: Sequence[re.Match[str] | None]) -> Float | None:
    """Midnights (N,) in s since 1970; None if a date does not exist."""
    written = {match["date"] for match in matches if match is not None}
    day_first = _day_first(written)
    days: dict[str, float] = {}
    for text in written:
        a, b, c = (int(part) for part in re.split(r"[-./]", text))
        year, month, day = (a, b, c) if a > 31 else (c, b, a) if day_first else (c, a, b)
        try:
            days[text] = DAY * (date(year + 2000 if year < 100 else year, month, day).toordinal() - EPOCH)
        except ValueError:
            return None
    return np.array([np.nan if match is None else days[match["date"]] for match in matches])


def _day_first(written: Iterable[str]) -> bool:
    """True for 31.12.2026, false for 12/31/2026. Raises ``ValueError`` if the order is ambiguous."""
    parts = [tuple(int(part) for part in re.split(r"[-./]", text)) for text in written]
    short = [part for part in parts if part[0] <= 31]
    if not short or any("." in text for text in written) or any(part[0] > 12 for part in short):
        return True
    if any(part[1] > 12 for part in short):
        return False
    if len(short) > 1:
        raise ValueError("holds dates with ambiguous day and month, write them as 2026-12-31: it has")
    return False
