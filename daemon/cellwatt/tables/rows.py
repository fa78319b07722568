"""Rows of a text table: separator, comments, names and cells, as spreadsheets and loggers write them."""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from cellwatt.tables.names import understood

SEPARATORS: Final = (";", "\t", "|", ",", " ")
"""In order of preference; a blank stands for any number of blanks."""
ALONE: Final = "\x1f"
"""Separator of a table of one column: a character that texts do not contain."""
_LOOKED_AT: Final = 100
"""Number of rows from which the separator is found."""
_COMMENT: Final = re.compile(r"\s*(#(?!N/A|NA\b|DIV/0|VALUE!|REF!|NUM!|NAME\?|NULL!)|%|//)")
_DIRECTIVE: Final = re.compile(r'"?sep=(.)"?', re.IGNORECASE)
NUMBER: Final = re.compile(
    r"[-+\u2212]?(?=[.,]?\d)[\d.,'’\xa0\u202f]*(e[+-]?\d+)?|nan|\d+[-./:][-\d./:T ,]*Z?", re.IGNORECASE
)
"""A number, a date or a time, which is not a name."""
_BEGUN: Final = re.compile(r"[-+](?:[.,]?)|[-+]?(?=[.,]?\d)[\d.,]*e[-+]?", re.IGNORECASE)
"""The beginning of a number."""
_DECIMAL: Final = re.compile(r"\d[.,]\d")
_BLANK: Final = ' \t\xa0,;|"'
_OPENED: Final = re.compile(r'(?:^|[,;\t|])\s*"(?:[^"]|"")*$')
"""A line that ends within quotes."""


@dataclass(frozen=True)
class Rows:
    """Rows of a text, without empty rows and comments."""

    separator: str
    names: tuple[str, ...]
    """Names of all columns; "" for a column without a name."""
    records: tuple[str, ...]
    """Data rows, each with as many cells as names."""
    numbers: tuple[int, ...]
    """Number of each row in the file, from 1, as a spreadsheet shows it."""
    torn: int = 0
    """Number of the last row if the file ends within it: it is left out; 0 if the file does not."""


def rows_of(text: str) -> Rows:
    """Split a text into rows. Raises ``ValueError``, with the row, if it is not a table."""
    every = [(number, record) for number, record in enumerate(_records(text), start=1) if record.strip(_BLANK)]
    directive = _DIRECTIVE.fullmatch(every[0][1].strip(" ")) if every else None
    every = every[1:] if directive else every
    rows = [(number, record) for number, record in every if not _COMMENT.match(record)]
    if not rows:
        raise ValueError("it holds comments alone" if every else "it is empty")
    numbers, records = [number for number, _ in rows], [record for _, record in rows]
    stated, looked_at = directive[1] if directive else "", records[:_LOOKED_AT]
    separator, names = stated or _separator(looked_at), list[str]()
    first = _first_of_names(records, separator)
    words = filter(None, re.split(r'[;\t|, "]+', records[first]))  # whatever the separator is
    if all(map(NUMBER.fullmatch, words)) or _holds_numbers(cells_in(records[first], separator)):
        comments = [_COMMENT.sub("", record).strip(" #%/") for number, record in every if number < numbers[0]]
        commented, names = _commented(comments, looked_at, stated)
        first, separator = 0, commented if names else separator
    if not names:
        names = _names(records[first], separator, _width(records[first + 1 : first + 1 + _LOOKED_AT], separator))
        first += 1
    no_names = [name for name in names if NUMBER.fullmatch(name)]
    if len(no_names) == sum(map(bool, names)) or (_holds_numbers(names) and any(map(_DECIMAL.search, no_names))):
        raise ValueError("no names in its first row: write t, q_1, …, tau_1, … above the columns")
    again = records[first - 1] if first else None  # loggers that were started again append their names
    kept = [i for i in range(first, len(records)) if records[i] != again]
    numbers, records, torn = [numbers[i] for i in kept], [records[i] for i in kept], 0
    if records and not text.endswith("\n"):
        last = cells_in(records[-1], separator)
        if _BEGUN.fullmatch(last[-1]) or (len(last) < len(names) and not _fits(last, names)):
            torn, numbers, records = numbers[-1], numbers[:-1], records[:-1]
    fitted = [_fitted(record, number, names, separator) for number, record in zip(numbers, records, strict=True)]
    return Rows(separator, tuple(names), tuple(fitted), tuple(numbers), torn)


def _records(text: str) -> list[str]:
    """Lines; lines within one pair of quotes are joined. Raises ``ValueError`` if quotes are not closed."""
    lines = text.split("\n")
    if '"' not in text:
        return lines
    out: list[str] = []
    within: list[str] = []
    for line in lines:
        if within:
            within.append(line)
            if line.count('"') % 2:
                out.append(" ".join(within))
                within = []
        elif line.count('"') % 2 and _OPENED.search(line):
            within = [line]
        else:
            out.append(line)
    if len(within) == 1:  # the file ends within a cell
        out.append(within[0].rpartition('"')[0].rstrip(_BLANK))
    elif within:
        raise ValueError(f"the quotes that begin in row {len(out) + 1} are not closed")
    return out


def cells_in(record: str, separator: str) -> list[str]:
    """The cells of a row, without quotes. Raises ``ValueError``."""
    found = record.split(separator)
    if '"' in record:
        try:
            found = next(csv.reader([record], delimiter=separator, skipinitialspace=True), [])
        except csv.Error as error:
            raise ValueError(f"the row that begins with {record[:20]!r}: {error}") from error
    return list(filter(None, found)) if separator == " " else found


def _filled(cells: Sequence[str]) -> int:
    """Number of cells up to the last non-empty one."""
    return max((i for i, cell in enumerate(cells, start=1) if cell.strip()), default=0)


def _separator(records: Sequence[str]) -> str:
    """The separator with which most rows fit the row of names."""
    best, separator = 0, ALONE
    for each in SEPARATORS:
        first, *below = records[_first_of_names(records, each) :]
        rows = [cells_in(record, each) for record in below]
        names = _names(first, each, max(map(_filled, rows), default=0))
        # Commas or semicolons with blanks behind them.
        both = all(cell.endswith((",", ";")) for row in (names, *rows[:1]) for cell in row[:-1])
        if len(names) > 1 and not both and (fit := sum(_fits(row, names) for row in rows) or not rows) > best:
            best, separator = fit, each
    if not best and records:  # none fits: the first separator in the row of names
        separator = next((each for each in SEPARATORS[:-1] if each in records[0]), ALONE)
    return separator


def _fits(cells: Sequence[str], names: Sequence[str]) -> bool:
    """True if each filled cell has a name and each name a cell."""
    return _filled(cells) <= len(names) and not any(names[len(cells) :])


def _first_of_names(records: Sequence[str], separator: str) -> int:
    """Index of the row of names: the first with as many cells as the rows below, or else with several cells.

    It has no numbers; 0 if there is no such row.
    """
    rows = [cells_in(record, separator) for record in records[:_LOOKED_AT]]
    for least in (max(map(_filled, rows)), 2):
        first = next((i for i, row in enumerate(rows) if _filled(row) >= max(2, least)), 0)
        if not _holds_numbers(rows[first]):
            return first
    return 0


def _holds_numbers(cells: Sequence[str]) -> bool:
    """True for a row that holds numbers, and no name that is known: it is not the row of names."""
    return any(NUMBER.fullmatch(cell.strip(_BLANK)) for cell in cells) and not any(map(understood, cells))


def _names(record: str, separator: str, width: int) -> list[str]:
    """Names in a row; if the rows below have fewer cells, separators within brackets belong to names."""
    cells = cells_in(record, separator)
    if _filled(cells) > width:
        joined: list[str] = []
        for cell in cells:
            if joined and any(joined[-1].count(opens) > joined[-1].count(closes) for opens, closes in ("()", "[]")):
                joined[-1] += separator + cell
            else:
                joined.append(cell)
        cells = joined if _filled(joined) == width else cells
    return [cell.strip(' \t\xa0\ufeff"') for cell in cells]


def _commented(comments: Sequence[str], records: Sequence[str], separator: str) -> tuple[str, list[str]]:
    """Separator, and names from the last comment with as many words as the rows have cells; empty without one."""
    best = separator or ALONE, list[str]()
    for comment in reversed(comments):
        each = separator or _separator([comment, *records])
        width = _width(records, each)
        names = [name.strip(",;") for name in _names(comment, each, width)]
        named = _filled(names) == width and not any(map(NUMBER.fullmatch, filter(None, names)))
        if named and len(names) > len(best[1]):
            best = each, names
    return best


def _width(records: Sequence[str], separator: str) -> int:
    return max((_filled(cells_in(record, separator)) for record in records), default=0)


def _fitted(record: str, number: int, names: Sequence[str], separator: str) -> str:
    """The row padded or cut to the number of names. Raises ``ValueError`` if non-empty cells lack a name."""
    plain, expected = '"' not in record, len(names)
    if plain and separator == " ":
        record = separator.join(cells_in(record, separator))
    if plain and record.count(separator) + 1 == expected:
        return record
    cells = cells_in(record, separator)
    if not _fits(cells, names):
        hint = ""
        if len(cells) > expected:
            hint = ": is one a decimal comma?" if separator == "," else ": is one part of a text? put it in quotes"
        raise ValueError(f"row {number} has {len(cells)} cells, expected {expected} as in the row of names{hint}")
    cells += [""] * (expected - len(cells))
    if plain:
        return separator.join(cells[:expected])
    return separator.join('"' + cell.replace('"', '""') + '"' for cell in cells[:expected])
