"""Lines of a screen: columns that fit its width, and glyphs that a terminal without UTF-8 has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from rich.cells import cell_len
from rich.text import Text

from cellwatt.live.sparkline import BARS

_PLAIN: Final = str.maketrans(
    {**dict(zip(BARS, "_.:-=+*#", strict=True)), **dict(zip("●·–−±×…½→", "*---~x.2>", strict=True))}
)


@dataclass(frozen=True, slots=True)
class Column:
    """A column of a table. Those with the highest ``spare`` are left out first where the width does not suffice."""

    name: str
    right: bool = False
    spare: int = 0


def table(columns: Sequence[Column], rows: Sequence[Sequence[str | Text]], width: int) -> list[Text]:
    """Lines of a table with a header, at most ``width`` cells wide."""
    shown = list(range(len(columns)))
    widths = [max(cell_len(str(cell)) for cell in (columns[i].name, *(row[i] for row in rows))) for i in shown]
    while sum(widths[i] + 2 for i in shown) > width and any(columns[i].spare for i in shown):
        shown.remove(max(shown, key=lambda i: columns[i].spare))
    lines = [_row([Text(columns[i].name, "bold") for i in shown], shown, columns, widths)]
    lines += [_row([_text(row[i]) for i in shown], shown, columns, widths) for row in rows]
    return [fit(line, width) for line in lines]


def _row(cells: Sequence[Text], shown: Sequence[int], columns: Sequence[Column], widths: Sequence[int]) -> Text:
    line = Text()
    for cell, i in zip(cells, shown, strict=True):
        padding = " " * (widths[i] - cell.cell_len)
        line.append(padding * columns[i].right).append_text(cell).append(padding * (not columns[i].right) + "  ")
    line.rstrip()
    return line


def _text(cell: str | Text) -> Text:
    return cell if isinstance(cell, Text) else Text(cell)


def fit(line: Text, width: int) -> Text:
    """The line cut to a width, with an ellipsis."""
    line.truncate(max(1, width), overflow="ellipsis")
    return line


def plain(line: Text) -> Text:
    """The line in ASCII as far as our own glyphs go."""
    line.plain = line.plain.translate(_PLAIN)
    return line
