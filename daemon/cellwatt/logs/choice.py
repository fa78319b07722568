"""Which part of a log is meant: ``BAG#/left/joint_states``, ``DATASET#12``."""

from __future__ import annotations

from pathlib import Path
from typing import Final

MARK: Final = "#"


def chosen(path: Path) -> tuple[Path, tuple[str, ...]]:
    """The file or folder, and what follows ``#`` behind its name, parted at commas; () where nothing does."""
    text, at = str(path), 0
    while not Path(text).exists() and (at := text.find(MARK, at + 1)) > 0:
        if (place := Path(text[:at])).exists():
            return place, tuple(filter(None, (part.strip() for part in text[at + 1 :].split(","))))
    return path, ()


def how(path: Path, names: list[str]) -> str:
    """For messages: the alternatives, and how one of them is chosen."""
    listed = ", ".join(names) if len(names) <= 6 else f"{', '.join(names[:3])}, … {names[-1]}"
    return f"{listed}; choose one as '{path}{MARK}{names[0]}'"
