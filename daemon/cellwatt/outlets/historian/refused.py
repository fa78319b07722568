"""Lines that the server will never take, in a file with the reasons: for a person to look at."""

from __future__ import annotations

import contextlib
import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Final

from cellwatt.errors import why

FILE: Final = "historian-refused.txt"
LARGEST: Final = 16_000_000
"""Bytes of the file; then it becomes ``.1``, in place of the one before."""

log = logging.getLogger(__name__)


def keep(folder: Path | None, lines: Sequence[str], reason: str) -> None:
    """Append lines with the reason above; blocks. Without a folder, or where that cannot be, the log alone tells."""
    log.warning("influx: %d lines are refused for good: %s", len(lines), reason)
    if folder is None:
        return
    path = folder / FILE
    try:
        with contextlib.suppress(FileNotFoundError):
            if path.stat().st_size > LARGEST:
                path.replace(path.with_name(f"{FILE}.1"))
        with path.open("a") as file:
            file.write(f"# {' '.join(reason.split())}\n")
            file.writelines(f"{line}\n" for line in lines)
    except OSError as error:
        log.warning("influx: %s cannot be written: %s", path, why(error))
