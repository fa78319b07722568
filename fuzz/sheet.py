"""Tables from a grammar of what spreadsheets, loggers and locales write: each is read as it was meant."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np

from cellwatt.emulation.signals import load_signals
from cellwatt.errors import RecordingError
from cellwatt.tables import read_table
from fuzz.target import Target, folder

Option = TypeVar("Option")

LOCALES: Final = (
    (";", ","),
    (";", "."),
    (",", "."),
    ("\t", ","),
    ("\t", "."),
    (" ", "."),
    (" ", ","),
    ("|", "."),
    (",", ","),
)
"""Separator and decimal mark."""
ENCODINGS: Final = ("utf-8", "utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "cp1252")
MISSING: Final = ("", "NaN", "nan", "NA", "#N/A", "null", "None", "#DIV/0!")
VALUES: Final = (0.0, 1.0, -1.0, 12.0, 0.5, -0.25, 1234.5, 3e-7, -2.5e8, math.nan)
WORDS: Final = ("ERR", "overflow", "--", "1.2.3.4", "12 V", "0x1F", "1,2,3")


@dataclass(frozen=True)
class Sheet:
    """A file and the truth about it."""

    content: bytes
    time: list[float]
    """s."""
    position: list[list[float]]
    """One list of rad for each joint; NaN where the cell is empty or odd."""
    odd: tuple[str, int, str] | None
    """A word of no number: the word, its row and its column as a spreadsheet shows them."""
    odd_joint: int | None = None


@dataclass
class Choices:
    """Choices by the bytes of an input; the first option behind their end."""

    data: bytes
    at: int = 0

    def of(self, options: tuple[Option, ...]) -> Option:
        """One of the options."""
        byte = self.data[self.at] if self.at < len(self.data) else 0
        self.at += 1
        return options[byte % len(options)]

    def often(self) -> bool:
        """True for one byte of four."""
        return self.of((False, False, False, True))


@dataclass
class _Writer:
    """The words of one file."""

    separator: str
    mark: str
    choices: Choices

    def number(self, value: float) -> tuple[str, float]:
        """A number's text and the value that it has."""
        if math.isnan(value):
            empty = self.choices.of(MISSING)
            return (empty if empty or self.separator != " " else "nan"), value
        text = f"{value:{self.choices.of(('g', '.4f', '.4e', '.10g'))}}"
        truth = float(text)
        if self.choices.often() and "e" not in text and "." in text and abs(value) >= 1000:
            group = self.choices.of(("." if self.mark == "," else ",", "\u00a0", "'"))
            text = f"{truth:,}".replace(",", "_").replace(".", self.mark).replace("_", group)
        elif self.mark == ",":
            text = text.replace(".", ",")
        if value > 0 and self.choices.often():
            text = f"+{text}"
        return text, truth

    def quoted(self, text: str, always: bool) -> str:
        """A cell, in quotes where it needs them."""
        return f'"{text}"' if always or self.separator in text else text


def letter(column: int) -> str:
    """What a spreadsheet calls one of the first 26 columns, from 0."""
    return "ABCDEFGHIJKLMNOPQRSTUVWXYZ"[column]


def drawn(data: bytes) -> Sheet:
    """The sheet of an input."""
    choices = Choices(data)
    separator, mark = choices.of(LOCALES)
    writer = _Writer(separator, mark, choices)
    joints, count = choices.of((1, 2, 3)), choices.of((2, 3, 5, 9))
    degrees = choices.of(("", " [°]", " (deg)", "_deg"))
    stem = choices.of(("q_{}", "q{}", "Q {}", "joint_{}.position"))
    names = [stem.format(i + 1) + degrees for i in range(joints)]
    if separator == " ":
        names = [name.replace("Q ", "Q_").replace(" ", "") for name in names]
    time, columns = _time(writer, count)
    position: list[list[float]] = []
    odd: tuple[str, int, str] | None = None
    odd_joint = choices.of((None, None, None, 0)) if choices.often() else None
    odd_row = choices.of(tuple(range(count)))
    for j, name in enumerate(names):
        cells, truth = zip(*(writer.number(choices.of(VALUES)) for _ in range(count)), strict=True)
        cells = [*cells]
        if j == odd_joint:
            word = choices.of(WORDS)
            cells[odd_row] = word.replace(" ", "") if separator == " " else word
        columns.append((name, cells))
        position.append([value * (math.pi / 180 if degrees else 1.0) for value in truth])
    if choices.often() and separator != " ":
        text = choices.of(("remark", "remark, cold", "a;b", "")), ["start, cold", *[""] * (count - 1)]
        columns.insert(choices.of((0, 1, 2)), text)
        if choices.often():
            columns.append((text[0], ["1"] * count))
    if choices.often() and separator != " ":
        columns.insert(0, ("", [str(i) for i in range(count)]))  # the numbers of rows that pandas writes
    content, first = _written(writer, columns, choices)
    if odd_joint is not None:
        place = [name for name, _ in columns].index(names[odd_joint])
        word = columns[place][1][odd_row]
        odd = word, first[odd_row], letter(place)
    return Sheet(content, time, position, odd, odd_joint)


def _time(writer: _Writer, count: int) -> tuple[list[float], list[tuple[str, list[str]]]]:
    """Times s and their columns."""
    seconds = [86398.5 + 0.5 * i for i in range(count)]
    form = writer.choices.of(("s", "ms", "iso", "two columns", "clock", "half days"))
    if writer.separator == " " and form in ("iso", "half days"):
        form = "s"
    comma = "," if writer.mark == "," else "."
    if form == "s":
        return seconds, [("t", [f"{s:g}".replace(".", writer.mark) for s in seconds])]
    if form == "ms":
        return seconds, [("Time_ms" if writer.separator == " " else "Time [ms]", [f"{1000 * s:.0f}" for s in seconds])]
    since = [1772323200.0 + s for s in seconds]
    clocks = [_clock(s % 86400, comma) for s in seconds]
    days = [s >= 86400 for s in seconds]
    if form == "iso":
        return since, [
            ("timestamp", [f"2026-03-0{2 if later else 1}T{c}" for c, later in zip(clocks, days, strict=True)])
        ]
    if form == "two columns":
        german = writer.choices.of((True, False))
        dates = [(f"0{d}.03.2026" if german else f"2026-03-0{d}") for d in (2 if later else 1 for later in days)]
        titles = ("Datum", "Uhrzeit") if german else ("Date", "Time")
        return since, [(titles[0], dates), (titles[1], clocks)]
    if form == "clock":
        return seconds, [("time", clocks)]
    halves = [
        f"3/14/2026 12:00:{_rest(s)} AM" if later else f"3/13/2026 11:59:{_rest(s)} PM"
        for s, later in zip(seconds, days, strict=True)
    ]
    return [1773360000.0 + s for s in seconds], [("time", halves)]


def _clock(second: float, comma: str) -> str:
    return f"{int(second // 3600):02}:{int(second % 3600 // 60):02}:{_rest(second)}".replace(".", comma)


def _rest(second: float) -> str:
    return f"{second % 60:04.1f}"


def _written(writer: _Writer, columns: list[tuple[str, list[str]]], choices: Choices) -> tuple[bytes, list[int]]:
    """Bytes of the file, and the row number of each data row."""
    separator, count = writer.separator, len(columns[0][1])
    every, named = choices.of((False, False, True)), choices.of((False, True))
    names = [writer.quoted(name, every or named) for name, _ in columns]
    rows = [[writer.quoted(cells[i], every) for _, cells in columns] for i in range(count)]
    empty = choices.of((0, 1, 2)) if separator in ";,\t" else 0
    where = choices.of(("both", "rows", "names")) if empty else ""
    tail = separator * empty
    lines: list[str] = []
    if choices.often() and separator != " ":
        lines.append(f"sep={separator}")
    if choices.often():
        lines += ["# made by a logger, version 2;1", ""][: choices.of((1, 2))]
    header = separator.join(names) + (tail if where in ("both", "names") else "")
    commented = (
        choices.often() and not any(map(_wordy, (cell for row in rows[:1] for cell in row))) and "°" not in header
    )
    lines.append(f"# {header}" if commented else header)
    numbers: list[int] = []
    for row in rows:
        if choices.often():
            lines.append(choices.of(("", tail, separator * (len(names) - 1) + tail, "# pause")))
        lines.append(separator.join(row) + (tail if where in ("both", "rows") else ""))
        numbers.append(len(lines))
    lines += [separator * (len(names) - 1)] * choices.of((0, 0, 3))
    newline = choices.of(("\n", "\r\n", "\r"))
    text = newline.join(lines) + newline * choices.of((0, 1, 2))
    encoding = choices.of(ENCODINGS)
    return text.encode(encoding, errors="replace" if encoding == "cp1252" else "strict"), numbers


def _wordy(cell: str) -> bool:
    return cell.strip('"') in WORDS or any(c.isalpha() for c in cell.replace("e", "").replace("E", ""))


def run(data: bytes) -> None:
    """The values are those that were written, a word of no number is refused by its cell, and commands agree."""
    sheet = drawn(data)
    path = folder() / "sheet.csv"
    path.write_bytes(sheet.content)
    table = read_table(path)
    np.testing.assert_allclose(table.rising_time(), sheet.time, rtol=0, atol=1e-6)
    signals = load_signals(path)
    assert set(signals.columns) >= set(table.columns) - {table.clock}
    for i, truth in enumerate(sheet.position):
        try:
            found = table.channel(f"joint_{i + 1}.position")
        except RecordingError as error:
            assert i == sheet.odd_joint and sheet.odd is not None, error
            word, row, column = sheet.odd
            assert f"first {word!r} in row {row}, column {column}" in str(error), (str(error), sheet.odd)
            continue
        assert i != sheet.odd_joint, sheet.odd
        np.testing.assert_allclose(found, truth, rtol=1e-12)


def seeds() -> Iterable[bytes]:
    """Every locale, and every byte once."""
    yield from (bytes([i]) + bytes(range(64)) for i in range(9))
    yield bytes(range(256))


TARGET = Target(run, seeds, 256)
