"""Tables as aligned columns, or with one paragraph per row if the terminal is too narrow."""

from __future__ import annotations

import shutil
import sys
import textwrap
from collections.abc import Iterable, Sequence
from typing import Final

import click

NO_BREAK: Final = "\N{NO-BREAK SPACE}"


def show_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table on standard output; if it is too wide for the terminal, print one paragraph per row."""
    table = [tuple(row) for row in rows]
    lines = aligned([header, *table])
    width = shutil.get_terminal_size().columns
    narrow = sys.stdout is not None and sys.stdout.isatty() and max(map(len, lines)) > width
    click.echo(stacked(header, table, width) if narrow else "\n".join(lines))


def aligned(rows: Sequence[Sequence[str]], *, numbers: bool = False) -> list[str]:
    """Rows as lines with aligned columns; with ``numbers`` all columns but the first are right-aligned."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    right = [numbers and i > 0 for i in range(len(widths))]
    cells = ([c.rjust(w) if r else c.ljust(w) for c, w, r in zip(row, widths, right, strict=True)] for row in rows)
    return ["  ".join(row).rstrip() for row in cells]


def stacked(header: Sequence[str], rows: Sequence[Sequence[str]], width: int) -> str:
    """Return a paragraph per row: its first value, then each other value after the name of its column."""
    lines = []
    for first, *others in rows:
        pairs = zip(header[1:], others, strict=True)
        values = ", ".join(f"{name} {value}".replace(" ", NO_BREAK) for name, value in pairs if value)
        text = textwrap.fill(values, max(width, 20) - 2, break_long_words=False, break_on_hyphens=False)
        lines += [first, textwrap.indent(text.replace(NO_BREAK, " "), "  ")]
    return "\n".join(lines)
