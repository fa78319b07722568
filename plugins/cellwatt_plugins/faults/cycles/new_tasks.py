"""Motion that is no known cycle: new tasks, and moves between tasks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt_plugins.faults.cycles.loops import closed_spans
from cellwatt_plugins.faults.cycles.match import Match
from cellwatt_plugins.faults.cycles.pattern import POSE, Pattern
from cellwatt_plugins.faults.cycles.runs import Run

FEWEST = 3
"""Moves in a row that are in no known task before they are called a task."""


def new_tasks(runs: Sequence[Run], matches: Sequence[Match], patterns: Sequence[Pattern]) -> list[tuple[int, int]]:
    """First and last run of each cycle of a task that is not known.

    Moves of known tasks, as where the recording begins or ends within a cycle, and moves to a start are none.
    """
    out: list[tuple[int, int]] = []
    begins = [0, *(match.last + 1 for match in matches)]
    for first, end in zip(begins, [*(match.first for match in matches), len(runs)], strict=True):
        group = runs[first:end]
        if sum(not _known(run, patterns) for run in group) < FEWEST:
            continue
        spans = closed_spans(group, FEWEST) or [(0, len(group) - 1)]
        out += [(first + a, first + b) for a, b in spans]
    return out


def _known(run: Run, patterns: Sequence[Pattern]) -> bool:
    """True if some pattern has a move from and to these poses."""
    here = np.hstack([run.before, run.after])
    return any((np.abs(np.hstack(pattern.poses) - here) < POSE).all(axis=1).any() for pattern in patterns)
