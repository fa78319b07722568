"""Files and folders that a command reads: on this disk, or at a URL, from where they are fetched."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any, Final

import click

from cellwatt.fetch import MissingError, fetch, is_url
from cellwatt.logs.choice import MARK, chosen
from cellwatt.progress import show_progress


class Input(click.Path):
    """A path that is there, or a URL as fsspec knows them (``s3://bucket/key``), given as the path of a copy.

    ``#`` and the part of a log that is meant may follow a path.
    """

    def convert(self, value: str | os.PathLike[str], param: click.Parameter | None, ctx: click.Context | None) -> Any:
        """Path of the file or folder. Raises ``CellwattError`` where a URL cannot be fetched."""
        if isinstance(value, str) and is_url(value) and not Path(value).exists():
            if ctx is not None and ctx.resilient_parsing:  # the words of a line that is being typed
                return Path(value)
            try:
                with show_progress(quiet=ctx is not None and bool(ctx.params.get("quiet"))):
                    value = fetch(value)
            except MissingError as error:
                self.fail(str(error), param, ctx)
        place, choice = chosen(Path(value))
        if choice:
            return Path(f"{place}{MARK}{','.join(choice)}")
        return super().convert(value, param, ctx)


INPUT: Final = Input(exists=True, path_type=Path)
"""In place of ``click.Path(exists=True, path_type=Path)`` for what a command reads."""
