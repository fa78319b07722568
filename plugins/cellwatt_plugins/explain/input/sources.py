"""The files of each run: its recording, its meter's own table and its simulation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from cellwatt.errors import RecordingError
from cellwatt_plugins.robot.meter.file import with_meters
from cellwatt_plugins.robot.simulated import is_simulator

ENDINGS = (".part", ".parquet", ".csv", ".txt", ".mcap", ".recording", ".simulation")
"""Endings that are removed from a file's name, the last one first, to obtain the name of the run."""


@dataclass(frozen=True)
class Source:
    """The files of one run."""

    name: str
    """Name of the run, e.g. ``run_01``."""
    recording: Path
    meter: Path | None = None
    """Table of power on a clock of its own."""
    simulation: Path | None = None
    """Table of the simulation; None if no table is given or a simulator's own file is run on each recording."""


def sources(recordings: Sequence[Path], simulations: Sequence[Path], meters: Sequence[Path] = ()) -> list[Source]:
    """The files of each run.

    A simulation belongs to the recording of the same name (``run_01.recording``, ``run_01.simulation``), otherwise to
    the recording at the same position in the list. ``meters`` are matched by position. Raises ``RecordingError`` if two
    recordings have the same name or the files cannot be matched.
    """
    metered = with_meters(recordings, meters)
    tables = _matched(recordings, () if simulator_file(simulations) else simulations)
    every = zip(_names(recordings), metered, tables, strict=True)
    return [Source(name, recording, meter, table) for name, (recording, meter), table in every]


def simulator_file(simulations: Sequence[Path]) -> Path | None:
    """The simulator's own file among ``simulations``; None if these are tables."""
    files = [path for path in simulations if is_simulator(path)]
    if files and len(simulations) > 1:
        raise RecordingError(f"{files[0]}: a simulator runs on every recording: give it without other simulations")
    return files[0] if files else None


def run_name(path: Path) -> str:
    """A file's name without its endings: ``run_01`` of ``run_01.recording.parquet``."""
    name = path.name
    while (shorter := next((name.removesuffix(e) for e in ENDINGS if name.endswith(e)), "")) != "":
        name = shorter
    return name


def _names(recordings: Sequence[Path]) -> list[str]:
    """Name of each run; files of the same name in several folders are prefixed with the name of the folder."""
    names = [run_name(path) for path in recordings]
    if len(set(names)) < len(names):
        names = [f"{path.resolve().parent.name}/{name}" for path, name in zip(recordings, names, strict=True)]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise RecordingError(f"two recordings are called {twice}: give each once, under a name of its own")
    return names


def _matched(recordings: Sequence[Path], simulations: Sequence[Path]) -> list[Path | None]:
    """The simulation of each recording, None where it has none."""
    if not simulations:
        return [None] * len(recordings)
    by_name = {run_name(path): path for path in simulations}
    names = [run_name(path) for path in recordings]
    if len(by_name) == len(simulations) and len(set(names)) == len(names) and set(by_name) <= set(names):
        return [by_name.get(name) for name in names]
    if len(simulations) != len(recordings):
        raise RecordingError(
            f"{len(recordings)} recordings but {len(simulations)} simulations: give one for each in the same order, "
            "or under the same names (run_01.recording.parquet, run_01.simulation.parquet)"
        )
    return list(simulations)
