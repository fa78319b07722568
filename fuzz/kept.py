"""Which inputs of a corpus are worth keeping."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable
from pathlib import Path
from types import FrameType
from typing import Any

import cellwatt
import cellwatt_drivers
import cellwatt_plugins

PACKAGES = tuple(
    f"{Path(path).resolve()}/"
    for package in (cellwatt, cellwatt_drivers, cellwatt_plugins)
    for path in package.__path__
)
"""Folders, not names: a clone lies in a folder that is called cellwatt, too."""

Branch = tuple[str, int, int]
"""A file, and two lines of it that ran one after the other."""


def smallest(run: Callable[[bytes], None], inputs: Iterable[bytes], budget: int) -> list[bytes]:
    """Inputs, small ones first, that each run a branch that those before do not; at most ``budget`` bytes in all."""
    known: set[Branch] = set()
    chosen: list[bytes] = []
    left = budget
    for data in sorted(inputs, key=lambda data: (len(data), data)):
        if len(data) > left:
            break
        branches = branches_of(run, data)
        if branches - known:
            known |= branches
            chosen.append(data)
            left -= len(data)
    return chosen


def branches_of(run: Callable[[bytes], None], data: bytes) -> set[Branch]:
    """Branches of the three packages that an input runs."""
    found: set[Branch] = set()

    def enter(frame: FrameType, event: str, _: Any) -> Any:
        name = frame.f_code.co_filename
        if not name.startswith(PACKAGES):
            return None
        before = frame.f_lineno

        def step(frame: FrameType, event: str, _: Any) -> Any:
            nonlocal before
            if event == "line":
                found.add((name, before, frame.f_lineno))
                before = frame.f_lineno
            return step

        return step

    sys.settrace(enter)
    try:
        run(data)
    finally:
        sys.settrace(None)
    return found
