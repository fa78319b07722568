"""Runs that are repeated: the median of each figure, with the least and the most."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import psutil

Figures = dict[str, Any]
Numbers = Mapping[str, float]
Spread = dict[str, float]


def repeated(run: Callable[[], Numbers], repeats: int) -> dict[str, Spread]:
    """Median of each figure over the runs, with the least and the most."""
    return spread([run() for _ in range(repeats)])


def spread(runs: Sequence[Numbers]) -> dict[str, Spread]:
    """Median of each figure over runs that are done, with the least and the most."""
    return {name: spread_of([run[name] for run in runs]) for name in runs[0]}


def spread_of(values: list[float]) -> Spread:
    """Median, least and most."""
    return {"median": statistics.median(values), "least": min(values), "most": max(values)}


def computed(pid: int) -> float:
    """Processor time of a process so far, s: user and kernel, all threads."""
    times = psutil.Process(pid).cpu_times()
    return float(times.user + times.system)


def memory(pid: int) -> float:
    """Memory that a process has for itself (USS), bytes."""
    return float(psutil.Process(pid).memory_full_info().uss)
