"""Cuts the files that ``cellwatt disaggregate`` reads from a recording of a campaign."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.errors import RecordingError
from cellwatt.tables import write_table
from cellwatt_plugins.energy.fixed import Steady, steady_power
from cellwatt_plugins.energy.procedure.loops import MISSING, Loop, find_loops
from cellwatt_plugins.energy.recordings import PowerTrace, RobotTrace
from cellwatt_plugins.robot import Arm

RATE: Final = 100.0
"""Smallest sample rate of the arm that is written, Hz; faster samples do not improve the result."""
MARGIN: Final = 1.0
"""Time before and after the arm's samples for which analyzer values are written, s, as a value covers earlier time."""
BESIDE: Final = 0.9
"""Share of the rests before the first and after the last repetition that is written."""


@dataclass(frozen=True)
class CutRun:
    """A run's file pair, ``written`` or not, its number of complete repetitions, and a sentence on each one refused."""

    run: str
    repetitions: int
    asked: int
    refused: tuple[str, ...]
    written: bool

    def in_words(self) -> str:
        """Text for the terminal."""
        done = f"{self.run}: {self.repetitions} of {self.asked} repetitions"
        remarks = "" if self.written else ", too few: not written, run it again"
        return "\n".join([done + remarks, *(f"  {sentence}" for sentence in self.refused)])


def cut_state(reading: PowerTrace, path: Path) -> Steady:
    """Write the power of a robot at rest as a table; returns its mean and uncertainty. Raises ``RecordingError``."""
    write_table(path, {"t": reading.time, "power": reading.power})
    return steady_power(reading)


def cut_programme(
    arm: Arm,
    motion: RobotTrace,
    reading: PowerTrace,
    payload: float,
    speeds: Sequence[float],
    repetitions: int,
    least: int | None,
    out: Path,
) -> list[CutRun]:
    """Write the runs of one program with ``payload`` kg to ``out/runs``.

    Each run needs ``least`` consecutive whole repetitions (default: all). Raises ``RecordingError`` if no repetition
    is recognised.
    """
    loops, notes = find_loops(arm, motion, speeds)
    if not loops:
        raise RecordingError(f"payload {payload:g} kg: {notes[0]}")
    loops = [_with_power(loop, reading) for loop in loops]
    runs = []
    for speed in speeds:
        name, best = f"{speed:g}_{payload:g}kg", _longest(loops, speed, motion)
        bad = [loop for loop in loops if loop.problem and loop.speed in (speed, 0.0 if speed == speeds[0] else speed)]
        remarks = [f"the repetition at t = {loop.start:.1f} s is refused: {loop.problem}" for loop in bad]
        if enough := len(best) >= (least or repetitions):
            _write_run(best, motion, reading, out / "runs" / name)
        runs.append(CutRun(name, len(best), repetitions, (*remarks, *(notes if speed == speeds[0] else ())), enough))
    return runs


def _with_power(loop: Loop, reading: PowerTrace) -> Loop:
    """Refuse a repetition for which values of the analyzer are missing."""
    inside = reading.time[(reading.time > loop.start - MARGIN) & (reading.time < loop.end + MARGIN)]
    edges = np.concatenate([[loop.start - MARGIN], inside, [loop.end + MARGIN]])
    silent = float(np.diff(edges).max())
    if loop.problem or silent <= MISSING * reading.step:
        return loop
    return replace(loop, problem=f"the analyzer's values are missing for {silent:.1f} s")


def _longest(loops: Sequence[Loop], speed: float, motion: RobotTrace) -> list[Loop]:
    """The longest sequence of usable repetitions at one speed, without missing samples between them."""
    best: list[Loop] = []
    now: list[Loop] = []
    for loop in loops:
        if now and _holes(motion, now[-1].last, loop.first).size:
            now = []
        now = [*now, loop] if loop.speed == speed and not loop.problem else []
        best = max(best, now, key=len)
    return best


def _holes(motion: RobotTrace, first: int, last: int) -> NDArray[np.intp]:
    """Samples from ``first`` to ``last`` that are followed by a hole."""
    return first + np.flatnonzero(np.diff(motion.time[first : last + 1]) > MISSING * motion.step)


def _write_run(loops: Sequence[Loop], motion: RobotTrace, reading: PowerTrace, path: Path) -> None:
    """Write the file pair of a run."""
    first, last = _edges(loops, motion)
    part = slice(first, last, max(1, int(1 / (motion.step * RATE) + 1e-6)))
    columns = {
        f"{stem}_{i + 1}": column
        for stem, values in (("q", motion.position), ("qd", motion.velocity), ("tau", motion.torque))
        for i, column in enumerate(values[part].T)
    }
    begin = float(motion.time[first])
    write_table(path.with_name(f"{path.name}.robot.parquet"), {"t": motion.time[part] - begin, **columns})
    inside = (reading.time >= begin - MARGIN) & (reading.time <= float(motion.time[last - 1]) + MARGIN)
    analyzer = {"t": reading.time[inside] - begin, "power": reading.power[inside]}
    write_table(path.with_name(f"{path.name}.analyzer.parquet"), analyzer)


def _edges(loops: Sequence[Loop], motion: RobotTrace) -> tuple[int, int]:
    """First sample, within the rest before the first repetition, and end, within the rest after the last."""
    pauses = [b.start - a.end for a, b in pairwise(loops)]
    margin = BESIDE * (float(np.median(pauses)) if pauses else 1.0)
    begin, end = np.searchsorted(motion.time, [loops[0].start - margin, loops[-1].end + margin]).tolist()
    before, after = _holes(motion, begin, loops[0].first), _holes(motion, loops[-1].last, end - 1)
    return int(before[-1]) + 1 if before.size else begin, int(after[0]) + 1 if after.size else end
