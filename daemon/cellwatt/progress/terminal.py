"""Tables: drawn in a terminal, plain aligned columns anywhere else."""

from __future__ import annotations

import sys
import textwrap
from collections.abc import Iterable, Sequence
from typing import Final

import click

GAP: Final = 2
"""Characters between two columns."""
SHORT: Final = 12
"""Characters of a value that stays on one line, such as a number with its unit."""
NO_BREAK: Final = "\N{NO-BREAK SPACE}"


def show_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table on standard output; one too wide for the terminal has a paragraph for each row instead."""
    table = [tuple(row) for row in rows]
    if sys.stdout.isatty():
        _draw(header, table)
        return
    widths = [max(map(len, column)) for column in zip(header, *table, strict=True)]
    for row in (header, *table):
        click.echo("  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip())


def _draw(header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    console = Console()
    whole = [[cell.replace(" ", NO_BREAK) if len(cell) <= SHORT else cell for cell in row] for row in rows]
    narrowest = [max(_longest_word(cell) for cell in column) for column in zip(header, *whole, strict=True)]
    if sum(narrowest) + GAP * (len(header) - 1) > console.width:
        click.echo(stacked(header, rows, console.width))
        return
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.show_edge = False
    for name, width in zip(header, _shared(narrowest, header, whole, console.width), strict=True):
        table.add_column(name, width=width)
    for row in whole:
        table.add_row(*map(Text, row))
    console.print(table)


def _shared(narrowest: Sequence[int], header: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> list[int]:
    """Widths of columns: what is left beside the narrowest goes to those on the left that could use it."""
    widths, left = list(narrowest), width - sum(narrowest) - GAP * (len(narrowest) - 1)
    for i, column in enumerate(zip(header, *rows, strict=True)):
        more = min(max(map(len, column)) - widths[i], left)
        widths[i] += more
        left -= more
    return widths


def stacked(header: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> str:
    """Return a paragraph for each row: its first value, then the others behind the names of their columns."""
    lines = []
    for first, *others in rows:
        told = (
            f"{name} {value}".replace(" ", NO_BREAK) for name, value in zip(header[1:], others, strict=True) if value
        )
        text = textwrap.fill(
            ", ".join(told),
            max(width, 20),
            initial_indent="  ",
            subsequent_indent="  ",
            break_long_words=False,
            break_on_hyphens=False,
        )
        lines += [first, text.replace(NO_BREAK, " ")]
    return "\n".join(lines)


def _longest_word(text: str) -> int:
    return max(map(len, text.split(" ")), default=0)
