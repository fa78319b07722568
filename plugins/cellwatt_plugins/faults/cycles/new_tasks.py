"""Finds new tasks in motion outside known cycles."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt_plugins.faults.cycles.loops import closed_spans
from cellwatt_plugins.faults.cycles.match import Match
from cellwatt_plugins.faults.cycles.pattern import POSE, Pattern
from cellwatt_plugins.faults.cycles.runs import Run

FEWEST = 3
"""Fewest moves between known cycles that are in no known task and count as a new task."""


def new_tasks(runs: Sequence[Run], matches: Sequence[Match], patterns: Sequence[Pattern]) -> list[tuple[int, int]]:
    """First and last run of each cycle of an unknown task.

    Excludes moves of known tasks (the recording may begin or end within a cycle) and moves to a start pose.
    """
    out: list[tuple[int, int]] = []
    begins = [0, *(match.last + 1 for match in matches)]
    for first, end in zip(begins, [*(match.first for match in matches), len(runs)], strict=True):
        group = runs[first:end]
        if sum(run.whole and not _known(run, patterns) for run in group) < FEWEST:
            continue
        spans = closed_spans(group, FEWEST) or [(0, len(group) - 1)]
        out += [(first + a, first + b) for a, b in spans]
    return out


def _known(run: Run, patterns: Sequence[Pattern]) -> bool:
    """True if a pattern has a move between these poses."""
    here = np.hstack([run.before, run.after])
    return any((np.abs(np.hstack(pattern.poses) - here) < POSE).all(axis=1).any() for pattern in patterns)
