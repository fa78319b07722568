"""Report pages of a cell: listed, found by their address, and the newest comparison with the simulation."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path, PurePosixPath
from typing import Annotated, Any, Final

from pydantic import BaseModel, BeforeValidator

from cellwatt.errors import why
from cellwatt.files import check_file, read_bytes
from cellwatt.report.facts import BrokenPageError, Facts, facts_in

EXPLAINED: Final = "simulation and recordings"
"""Kind of the pages that compare a simulation with recordings."""
FINDINGS: Final = "findings.json"
"""Figures of such a page for programs, beside it."""
LONGEST: Final = 64_000_000
"""Bytes of a page, and of its figures, that are read."""
_OTHER: Final = "~"
"""Before the number of the folder in the path of a report that is not in the first."""

Entry = tuple[str, Path, Facts]


def list_reports(folders: Sequence[Path]) -> dict[str, Any]:
    """Pages of cellwatt in some folders and below them, the newest first, and those that cannot be read; JSON-ready.

    ``path`` is that below the first folder; of another it begins with ``~`` and its place. Reads files: never call it
    on an event loop.
    """
    broken: list[str] = []
    entries = sorted(_pages(folders, broken), key=lambda entry: entry[2].made, reverse=True)
    return {"reports": [_told(path, facts) for path, _, facts in entries], "broken": broken}


def report_file(folders: Sequence[Path], path: str) -> Path | None:
    """File of a page under its ``path`` in ``list_reports``; None where none of that name is a page of cellwatt."""
    parts = PurePosixPath(path).parts
    folder = folders[0] if folders else None
    if parts and parts[0].startswith(_OTHER):
        number = parts[0].removeprefix(_OTHER)
        known = number.isascii() and number.isdecimal() and len(number) < 4 and 0 < int(number) < len(folders)
        folder, parts = (folders[int(number)] if known else None), parts[1:]
    if folder is None or not parts or "\0" in path or any(part in ("..", "/") for part in parts):
        return None
    file = folder.joinpath(*parts)
    try:
        return file if _inside(file, folder) and _facts(file) is not None else None
    except (OSError, BrokenPageError):
        return None


def newest_mismatch(folders: Sequence[Path]) -> dict[str, Any]:
    """Finding of the newest comparison of a simulation with recordings, JSON-ready; ``finding`` None where none is.

    ``before`` and ``after`` are the held-out errors of the simulation and of the model in ``unit``, for the ``channel``
    in which the simulation is worst against its noise; all None where the page has no figures beside it. ``effects``
    are what was found, the surest first.
    """
    entries = [entry for entry in _pages(folders, []) if entry[2].kind == EXPLAINED]
    if not entries:
        return {"finding": None}
    path, file, facts = max(entries, key=lambda entry: entry[2].made)
    return {**_told(path, facts), **_figures(file.with_name(FINDINGS))}


def _told(path: str, facts: Facts) -> dict[str, Any]:
    fields = {name: getattr(facts, name) for name in ("kind", "name", "finding", "tone", "made")}
    return {"path": path, **fields, "about": " · ".join(facts.about)}


# pages ----------------------------------------------------------------------------------------------


def _pages(folders: Sequence[Path], broken: list[str]) -> Iterator[Entry]:
    """Pages with their paths; the same file is told once, and faults go to ``broken``."""
    seen: set[str] = set()
    for number, folder in enumerate(folders):
        for file in sorted(folder.rglob("*.html")):
            try:
                real = os.path.realpath(file)
                if real in seen or not _inside(file, folder):
                    continue
                seen.add(real)
                facts = _facts(file)
            except BrokenPageError as error:
                broken.append(str(error))
                continue
            except OSError as error:
                broken.append(f"{file}: cannot be read: {why(error)}")
                continue
            if facts is not None:
                below = file.relative_to(folder).as_posix()
                yield (below if number == 0 else f"{_OTHER}{number}/{below}"), file, facts


def _inside(file: Path, folder: Path) -> bool:
    """True for an HTML file of the folder that no link leads out of it."""
    return file.suffix == ".html" and Path(os.path.realpath(file)).is_relative_to(os.path.realpath(folder))


def _facts(file: Path) -> Facts | None:
    """Facts of a page; None where it is no page of cellwatt. Raises ``OSError`` and ``BrokenPageError``."""
    check_file(file, LONGEST)  # a FIFO would block the reader
    status = file.stat()
    return _facts_of(file, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=2000)
def _facts_of(file: Path, modified: int, size: int) -> Facts | None:
    """The same, remembered while the file is not changed."""
    return facts_in(file)


# figures --------------------------------------------------------------------------------------------


def _finite(value: object) -> object:
    return None if isinstance(value, float) and not math.isfinite(value) else value


Number = Annotated[float | None, BeforeValidator(_finite)]


class _Fit(BaseModel):
    channel: str
    unit: str
    simulation: Number
    model: Number
    noise_floor: Number = None


class _Gain(BaseModel):
    channel: str = ""
    unit: str = ""
    before: Number = None
    after: Number = None


class _Effect(BaseModel):
    effect: str
    joint: int | None = None
    kind: str = ""
    confidence: Number = None
    statement: str = ""
    improvement: _Gain = _Gain()


class _Figures(BaseModel):
    findings: list[_Effect] = []
    fit: list[_Fit] = []


def _figures(file: Path) -> dict[str, Any]:
    """Figures beside a page, None where they are missing or damaged."""
    try:
        figures = _Figures.model_validate(json.loads(read_bytes(file, LONGEST)))
    except (OSError, ValueError, RecursionError):
        figures = _Figures()
    error: dict[str, Any] = dict.fromkeys(("channel", "unit", "before", "after"))
    if (worst := max(figures.fit, key=_worse, default=None)) is not None:
        error = {"channel": worst.channel, "unit": worst.unit, "before": worst.simulation, "after": worst.model}
    effects = sorted(figures.findings, key=lambda effect: effect.confidence or 0.0, reverse=True)
    told = [{**each.model_dump(exclude={"improvement"}), **each.improvement.model_dump()} for each in effects]
    return {**error, "effects": told}


def _worse(fit: _Fit) -> float:
    """Error of the simulation in noise floors, or as it is where none is known."""
    return -1.0 if fit.simulation is None else fit.simulation / (fit.noise_floor or 1.0)
