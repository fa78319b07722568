"""Runs of several ways, taken in turn so that a loud minute meets all of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from outlet.figures import Figures, Numbers, spread


def in_turn(ways: Mapping[str, Callable[[], Numbers]], repeats: int) -> Figures:
    """Median of each figure of each way over the runs, with the least and the most."""
    runs = [{name: way() for name, way in ways.items()} for _ in range(repeats)]
    return {name: spread([run[name] for run in runs]) for name in ways}
