"""Tables as aligned columns."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import click


def show_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    """Print a table on standard output."""
    click.echo("\n".join(aligned([header, *rows])))


def aligned(rows: Sequence[Sequence[str]], *, numbers: bool = False) -> list[str]:
    """Rows as lines with aligned columns; with ``numbers`` all columns but the first are right-aligned."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    right = [numbers and i > 0 for i in range(len(widths))]
    cells = ([c.rjust(w) if r else c.ljust(w) for c, w, r in zip(row, widths, right, strict=True)] for row in rows)
    return ["  ".join(row).rstrip() for row in cells]
