"""Report pages of a cell: their list, lookup by path, and the newest comparison with the simulation."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator, Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from cellwatt.errors import why
from cellwatt.files import read_bytes
from cellwatt.report.facts import LONGEST, BrokenPageError, Facts, facts_in

EXPLAINED: Final = "simulation and recordings"
"""Kind of the pages that compare a simulation with recordings."""
FINDINGS: Final = "findings.json"
"""Machine-readable file beside such a page."""
_OTHER: Final = "~"
"""Prefix of the folder's number in the path of a report that is not in the first folder."""

Entry = tuple[str, Path, Facts]


def list_reports(folders: Sequence[Path]) -> dict[str, Any]:
    """Pages of cellwatt in folders and their subfolders, the newest first, and unreadable pages; ready for JSON.

    ``path`` is relative to the first folder; for another folder it begins with ``~`` and the folder's index. Reads
    files: never call it on an event loop.
    """
    broken: list[str] = []
    entries = sorted(_pages(folders, broken), key=lambda entry: entry[2].made, reverse=True)
    return {"reports": [_described(path, facts) for path, _, facts in entries], "broken": broken}


def report_file(folders: Sequence[Path], path: str) -> Path | None:
    """File of the page with this ``path`` in ``list_reports``; None if there is no such page of cellwatt."""
    return next((file for known, file, _ in _pages(folders, []) if known == path), None)


def newest_mismatch(folders: Sequence[Path]) -> dict[str, Any]:
    """Finding of the newest comparison of a simulation with recordings, ready for JSON; ``finding`` None without one.

    ``before`` and ``after`` are the errors, in ``unit``, of the simulation and of the model on data not used for
    fitting, for the ``channel`` with the largest error of the simulation in noise floors; all None if the findings file
    is missing or damaged. ``effects`` are the findings, by decreasing confidence.
    """
    entries = [entry for entry in _pages(folders, []) if entry[2].kind == EXPLAINED]
    if not entries:
        return {"finding": None}
    path, file, facts = max(entries, key=lambda entry: entry[2].made)
    return {**_described(path, facts), **_figures(file.with_name(FINDINGS))}


def _described(path: str, facts: Facts) -> dict[str, Any]:
    fields = {name: getattr(facts, name) for name in ("kind", "name", "finding", "tone", "made")}
    return {"path": path, **fields, "about": " · ".join(facts.about)}


# pages ----------------------------------------------------------------------------------------------


def _pages(folders: Sequence[Path], broken: list[str]) -> Iterator[Entry]:
    """Yield pages with their paths, each file once; append errors to ``broken``."""
    seen: set[str] = set()
    for number, folder in enumerate(folders):
        for file in sorted(folder.rglob("*.html")):
            try:
                real = os.path.realpath(file)
                if real in seen or not Path(real).is_relative_to(os.path.realpath(folder)):
                    continue  # listed already, or a link that leads out of the folder
                seen.add(real)
                status = file.stat()
                facts = _facts_of(file, status.st_mtime_ns, status.st_size)
            except BrokenPageError as error:
                broken.append(str(error))
                continue
            except OSError as error:
                broken.append(f"{file}: cannot be read: {why(error)}")
                continue
            if facts is not None:
                below = file.relative_to(folder).as_posix()
                yield (below if number == 0 else f"{_OTHER}{number}/{below}"), file, facts


@lru_cache(maxsize=2000)
def _facts_of(file: Path, modified: int, size: int) -> Facts | None:
    """Facts of a page, cached until the file changes; None if it is not a page of cellwatt."""
    return facts_in(file)


# figures --------------------------------------------------------------------------------------------


_EFFECT: Final = {"effect": "", "joint": None, "kind": "", "confidence": None, "statement": ""}
_GAIN: Final = {"channel": "", "unit": "", "before": None, "after": None}


def _figures(file: Path) -> dict[str, Any]:
    """Figures from the findings file of a page, None if it is missing or damaged."""
    try:
        findings = json.loads(read_bytes(file, LONGEST))
        effects = sorted(findings.get("findings", ()), key=lambda effect: effect.get("confidence") or 0.0, reverse=True)
        shown = [{**_fields(each, _EFFECT), **_fields(each.get("improvement", {}), _GAIN)} for each in effects]
        worst = max(findings.get("fit", ()), key=_worse, default=None)
        fit = None if worst is None else [worst[name] for name in ("channel", "unit", "simulation", "model")]
    except (OSError, ValueError, RecursionError, LookupError, TypeError, AttributeError):
        fit, shown = None, []
    return {**dict(zip(("channel", "unit", "before", "after"), fit or [None] * 4, strict=True)), "effects": shown}


def _fields(values: Mapping[str, Any], wanted: Mapping[str, Any]) -> dict[str, Any]:
    return {name: values.get(name, default) for name, default in wanted.items()}


def _worse(fit: Mapping[str, Any]) -> float:
    """Error of the simulation in noise floors, or in its unit if the noise floor is unknown."""
    error = fit["simulation"]
    return -1.0 if error is None or math.isnan(error) else float(error / (fit.get("noise_floor") or 1.0))
