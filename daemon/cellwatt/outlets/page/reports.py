"""Report pages of a cell: listed, found by their address, and the newest comparison with the simulation."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

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
    return next((file for known, file, _ in _pages(folders, []) if known == path), None)


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
                if real in seen or not Path(real).is_relative_to(os.path.realpath(folder)):
                    continue  # told already, or a link leads out of the folder
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


_EFFECT: Final = {"effect": "", "joint": None, "kind": "", "confidence": None, "statement": ""}
_GAIN: Final = {"channel": "", "unit": "", "before": None, "after": None}


def _figures(file: Path) -> dict[str, Any]:
    """Figures beside a page, None where they are missing or damaged."""
    try:
        told = json.loads(read_bytes(file, LONGEST))
        effects = sorted(told.get("findings", ()), key=lambda effect: effect.get("confidence") or 0.0, reverse=True)
        shown = [{**_fields(each, _EFFECT), **_fields(each.get("improvement", {}), _GAIN)} for each in effects]
        worst = max(told.get("fit", ()), key=_worse, default=None)
        fit = None if worst is None else [worst[name] for name in ("channel", "unit", "simulation", "model")]
    except (OSError, ValueError, RecursionError, LookupError, TypeError, AttributeError):
        fit, shown = None, []
    return {**dict(zip(("channel", "unit", "before", "after"), fit or [None] * 4, strict=True)), "effects": shown}


def _fields(told: Mapping[str, Any], wanted: Mapping[str, Any]) -> dict[str, Any]:
    return {name: told.get(name, default) for name, default in wanted.items()}


def _worse(fit: Mapping[str, Any]) -> float:
    """Error of the simulation in noise floors, or as it is where none is known."""
    error = fit["simulation"]
    return -1.0 if error is None or math.isnan(error) else float(error / (fit.get("noise_floor") or 1.0))
