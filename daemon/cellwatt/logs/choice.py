"""Selection of a topic or an episode of a log: ``BAG#/left/joint_states``, ``DATASET#12``."""

from __future__ import annotations

from pathlib import Path
from typing import Final

MARK: Final = "#"


def chosen(path: Path) -> tuple[Path, tuple[str, ...]]:
    """Split a path into the file or folder and the names after ``#``, separated by commas; () without ``#``."""
    text, at = str(path), 0
    while not Path(text).exists() and (at := text.find(MARK, at + 1)) > 0:
        if (existing := Path(text[:at])).exists():
            return existing, tuple(filter(None, (part.strip() for part in text[at + 1 :].split(","))))
    return path, ()


def how(path: Path, names: list[str]) -> str:
    """List the alternatives for a message, and how to choose one."""
    listed = ", ".join(names) if len(names) <= 6 else f"{', '.join(names[:3])}, … {names[-1]}"
    return f"{listed}; choose one as '{path}{MARK}{names[0]}'"
