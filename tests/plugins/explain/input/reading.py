"""Files and runs as ``explain`` takes them in, before it looks for anything."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from cellwatt_plugins.explain.input.admission import admit
from cellwatt_plugins.explain.input.baseline import Baseline
from cellwatt_plugins.explain.input.reading import read_sources
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.input.sources import simulator_file, sources
from cellwatt_plugins.robot import Arm, RobotDescription


def read_runs(
    recordings: Sequence[Path], simulations: Sequence[Path], robot: RobotDescription, meters: Sequence[Path] = ()
) -> list[Run]:
    """The recordings as runs."""
    return read_sources(sources(recordings, simulations, meters), robot, simulator_file(simulations))


def examine(runs: Sequence[Run], arm: Arm) -> tuple[Baseline, list[str]]:
    """The baseline of the runs, and the remarks on them."""
    admitted = admit(runs, arm)
    return admitted.base, list(admitted.notes)
