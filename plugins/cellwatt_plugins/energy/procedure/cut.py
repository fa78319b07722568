"""The files that ``cellwatt disaggregate`` reads, cut from a recording of a campaign."""

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
from cellwatt_plugins.energy.procedure.loops import Loop, find_loops
from cellwatt_plugins.energy.procedure.recorded import Recorded, Rows, Span
from cellwatt_plugins.energy.recordings import Motion, Reading
from cellwatt_plugins.robot import Arm

Float = NDArray[np.float64]

RATE: Final = 100.0
"""Hz that are kept of the arm at least: what is faster teaches nothing more."""
MARGIN: Final = 1.0
"""s of the analyzer before and after the arm: a value of it stands for a time a little earlier."""
MISSING: Final = 5.0
"""Sample times without a sample: a hole, for which a run would be refused."""
BESIDE: Final = 0.9
"""Share of the rests before the first and after the last repetition that is kept."""


@dataclass(frozen=True)
class CutRun:
    """One file pair, or why there is none."""

    run: str
    repetitions: int
    """Complete repetitions that it holds."""
    asked: int
    refused: tuple[str, ...]
    """A sentence on each repetition that cannot be used."""
    written: bool

    def in_words(self) -> str:
        """For a person."""
        done = f"{self.run}: {self.repetitions} of {self.asked} repetitions"
        told = "" if self.written else ", too few: not written, run it again"
        return "\n".join([done + told, *(f"  {sentence}" for sentence in self.refused)])


@dataclass(frozen=True)
class Stretch:
    """Repetitions of one speed and payload, one after the other, that can all be used."""

    loops: tuple[Loop, ...]
    motion: Motion
    rows: Rows


def cut_state(recorded: Recorded, span: Span, path: Path) -> Steady:
    """Write the power of a robot at rest as a table, and say how well its mean is known. Raises ``RecordingError``."""
    power = recorded.power(span)
    time = _seconds(power.time, span.start)
    write_table(path, {"t": time, "power": power.values[:, 0]})
    return steady_power(Reading(str(path), time, power.values[:, 0]))


def cut_programme(
    recorded: Recorded,
    arm: Arm,
    span: Span,
    payload: float,
    speeds: Sequence[float],
    repetitions: int,
    least: int,
    out: Path,
) -> list[CutRun]:
    """Write the runs of one program with a ``payload`` in kg to ``out/runs``.

    Each needs ``least`` whole repetitions in a row. Raises ``RecordingError`` where not one repetition is recognised.
    """
    rows, power = recorded.motion(span), recorded.power(span)
    motion = _motion(rows, span.start, arm.joints)
    loops, notes = find_loops(arm, motion, speeds)
    if not loops:
        raise RecordingError(f"payload {payload:g} kg: {notes[0]}")
    measured = _seconds(power.time, span.start)
    loops = [_with_power(loop, measured) for loop in loops]
    stray = tuple(_sentence(loop) for loop in loops if not loop.speed)
    runs = []
    for i, speed in enumerate(speeds):
        name = f"{speed:g}_{payload:g}kg"
        best = _longest(loops, speed, motion)
        refused = tuple(_sentence(loop) for loop in loops if loop.speed == speed and loop.problem)
        also = (*stray, *notes) if i == 0 else ()
        enough = len(best) >= least
        if enough:
            _write_run(Stretch(tuple(best), motion, power), span, name, out / "runs")
        runs.append(CutRun(name, len(best), repetitions, (*refused, *also), enough))
    return runs


def _motion(rows: Rows, start: int, joints: int) -> Motion:
    position, velocity, torque = rows.values.reshape(len(rows.time), 3, joints).transpose(1, 0, 2)
    return Motion("the recording", _seconds(rows.time, start), position, velocity, torque)


def _with_power(loop: Loop, measured: Float) -> Loop:
    """Refuses a repetition during which the analyzer was silent."""
    inside = measured[(measured > loop.start - MARGIN) & (measured < loop.end + MARGIN)]
    edges = np.concatenate([[loop.start - MARGIN], inside, [loop.end + MARGIN]])
    silent, step = float(np.diff(edges).max()), float(np.median(np.diff(measured)))
    if loop.problem or silent <= 5 * step:
        return loop
    return replace(loop, problem=f"the analyzer's values are missing for {silent:.1f} s")


def _longest(loops: Sequence[Loop], speed: float, motion: Motion) -> list[Loop]:
    """The most repetitions of a speed, one after the other, that can all be used; no samples missing between them."""
    best: list[Loop] = []
    now: list[Loop] = []
    for loop in loops:
        if now and _holes(motion, now[-1].last, loop.first).size:
            now = []
        now = [*now, loop] if loop.speed == speed and not loop.problem else []
        best = max(best, now, key=len)
    return best


def _holes(motion: Motion, first: int, last: int) -> NDArray[np.intp]:
    """Samples from ``first`` to ``last`` after which some are missing."""
    return first + np.flatnonzero(np.diff(motion.time[first : last + 1]) > MISSING * motion.step)


def _sentence(loop: Loop) -> str:
    return f"the repetition at t = {loop.start:.1f} s is refused: {loop.problem}"


def _write_run(stretch: Stretch, span: Span, name: str, folder: Path) -> None:
    motion, power = stretch.motion, stretch.rows
    first, last = _edges(stretch)
    every = max(1, int(1 / (motion.step * RATE) + 1e-6))
    part = slice(first, last, every)
    columns = {
        f"{stem}_{i + 1}": values[part, i]
        for stem, values in (("q", motion.position), ("qd", motion.velocity), ("tau", motion.torque))
        for i in range(values.shape[1])
    }
    begin = float(motion.time[first])
    write_table(folder / f"{name}.robot.parquet", {"t": motion.time[part] - begin, **columns})
    measured = _seconds(power.time, span.start)
    inside = (measured >= begin - MARGIN) & (measured <= float(motion.time[last - 1]) + MARGIN)
    write_table(folder / f"{name}.analyzer.parquet", {"t": measured[inside] - begin, "power": power.values[inside, 0]})


def _edges(stretch: Stretch) -> tuple[int, int]:
    """Samples from within the rest before the first repetition to within the rest after the last."""
    motion, loops = stretch.motion, stretch.loops
    pauses = [b.start - a.end for a, b in pairwise(loops)]
    kept = BESIDE * (float(np.median(pauses)) if pauses else 1.0)
    begin, end = (int(i) for i in np.searchsorted(motion.time, [loops[0].start - kept, loops[-1].end + kept]))
    before, after = _holes(motion, begin, loops[0].first), _holes(motion, loops[-1].last, end - 1)
    return int(before[-1]) + 1 if before.size else begin, int(after[0]) + 1 if after.size else end


def _seconds(time: NDArray[np.int64], start: int) -> Float:
    return np.asarray((time - start) * 1e-9)
