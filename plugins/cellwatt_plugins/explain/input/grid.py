"""Resample logged rows to an even time grid without holes; filled-in samples are marked and noted."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import Akima1DInterpolator
from scipy.ndimage import binary_dilation, binary_opening, median_filter

from cellwatt.arrays import Bool, Float
from cellwatt.errors import RecordingError
from cellwatt_plugins.explain.input.repeated_rows import repeats
from cellwatt_plugins.explain.input.stamps import in_bursts, sampled
from cellwatt_plugins.robot.meter.held import onto
from cellwatt_plugins.robot.samples import SPARSE, most_points
from cellwatt_plugins.robot.stretches import stretches

LEAST_ROWS = 16
"""Smallest number of rows of a recording."""
SLOWEST = 1.2
"""Longest step between rows, s: beyond it the motion of an arm is not resolved, or the time is in another unit."""
COUNTED = 0.9
"""Step above which times in whole numbers are row numbers or ms: a clock in s with such a step has fractions."""
FEW = 0.01
"""Largest share of rows of a column that may be filled in."""
LONGEST = 1.0
"""Longest stretch without a number, s, that may be filled in; in slow recordings one row."""
ABSURD = 1e9
"""No quantity of a robot is that large in any unit: the bytes were damaged."""
EVEN = 0.02
"""Share of a step by which the times of an evenly sampled file may deviate."""
HOLE = 2.5
"""Distance of two rows, in steps, above which samples are missing between them."""
GLITCH = (3.0, 10.0)
"""Deviation of a value from its neighbours, in largest steps of the signal, above which it is a glitch: in ``DENSE``
recordings, and in others, in which a short move is a single row."""
JITTER = 0.01
"""rad by which a position may always deviate from its neighbours: encoder noise or a brake at rest causes as much."""
JERKED = 1.0
"""rad/s at which a position may deviate from its neighbours: in slow recordings a short move is a single row."""
DENSE = 0.02
"""Longest step between rows, s, at which a torque or velocity of one or two rows is no move of the arm."""
BESIDE = 0.15
"""s on each side of a hole of that length or more in which the smoothed motion depends on what was filled in."""


Kind = Literal["position", "slow", "lossy", "spare", "power"]
"""Kind of a column, where ``even`` treats it in a way of its own."""


@dataclass(frozen=True)
class Gridded:
    """Columns (N,) on an even grid."""

    time: Float
    """(N,) s."""
    columns: Mapping[str, Float]
    gaps: Bool
    """(N,) true where values were filled in."""
    exact_times: bool
    """False if the times of single rows were estimated from the positions."""
    notes: tuple[str, ...]


def even(
    place: str,
    time: Float,
    columns: Mapping[str, Float],
    kinds: Mapping[str, Kind],
    rows: NDArray[np.int64],
) -> Gridded:
    """Resample columns (R,) at ``time`` (R,) s to an even grid of their rate; ``rows`` (R,): row numbers for messages.

    Holes in time and single missing values are filled in and marked as gaps, and a first or last row with a missing
    value is left out, unless the column's kind is one of these:
    ``slow`` columns change over minutes: missing values are filled in without a mark, and a column without any value is
    omitted. If more than a few values are missing, ``lossy`` columns stay NaN there, and ``spare`` columns and the
    ``power`` are omitted. The power of a slow meter is held. Glitches of ``position``, ``lossy`` and ``spare`` columns
    count as missing, rows that repeat all positions are left out, and stamps corrected by them. Raises
    ``RecordingError`` if too much is missing, or if the time does not rise or jumps.
    """
    positions = [name for name in columns if kinds.get(name) == "position"]
    valid, notes = _rising(place, time, rows)
    time, rows, columns = time[valid], rows[valid], {name: values[valid] for name, values in columns.items()}
    _in_seconds(place, time)
    if (repeated := repeats([columns[name] for name in positions])).any():
        time, rows = time[~repeated], rows[~repeated]
        columns = {name: values[~repeated] for name, values in columns.items()}
        notes.append(_repetitions(place, repeated))
    filled, bad = _filled(place, time, columns, kinds, notes)
    # Without a value before or after it, an unusable one is not filled in: the recording is that much shorter.
    ends = slice(int(bad[0]), len(bad) - int(bad[-1]))
    time, rows, bad, filled = time[ends], rows[ends], bad[ends], {name: each[ends] for name, each in filled.items()}
    curved = [name for name in positions if np.isfinite(filled[name]).all()]
    stamps, (time, exact) = time, sampled(time, [filled[name] for name in curved])
    if time is not stamps:
        notes.append(_restamped(place, float(np.max(np.abs(stamps - time))), exact))
    grid = _grid(place, time, exact, rows)
    if grid is time:
        return Gridded(_line(time), filled, bad, exact, tuple(notes))
    gaps = _holes(time, grid) | (np.interp(grid, time, bad) > 0)
    columns = {
        name: onto(grid, time, values)
        if kinds.get(name) == "power"
        # Linear interpolation of an accelerating position errs by more than the noise of its encoder.
        else Akima1DInterpolator(time, values, method="makima")(np.clip(grid, time[0], time[-1]))
        if name in curved
        else np.interp(grid, time, values)
        for name, values in filled.items()
    }
    return Gridded(grid, columns, gaps, exact, tuple(notes))


def _filled(
    place: str, time: Float, columns: Mapping[str, Float], kinds: Mapping[str, Kind], notes: list[str]
) -> tuple[dict[str, Float], Bool]:
    """Columns (R,) without unusable values, by their ``kinds``, and the rows (R,) filled in; adds to ``notes``."""
    filled, bad = dict[str, Float](), np.zeros(len(time), np.bool_)
    for name, values in columns.items():
        kind, wrong = kinds.get(name), ~(np.abs(values) < ABSURD)
        if kind in ("position", "lossy", "spare") and not wrong.all():
            wrong |= _glitches(time, np.where(wrong, np.nan, values), kind)
        if kind == "lossy" and not _few(time, wrong):
            filled[name] = np.where(wrong, np.nan, values)
            if not wrong.all():
                notes.append(_lost(place, name, time, wrong))
        elif kind in ("spare", "power") and not _few(time, wrong):
            notes.append(f"{place}: {_unusable(name, time, wrong)}. It is not used")
        elif kind == "slow":
            if wrong.all():
                notes.append(f"{place}: {name} has no usable number: no temperature is used")
            else:
                filled[name] = np.interp(time, time[~wrong], values[~wrong])
        else:
            _few_enough(place, name, time, wrong)
            bad |= wrong
            filled[name] = np.interp(time, time[~wrong], values[~wrong]) if wrong.any() else values
            if (inner := wrong[1:-1]).any():
                first = time[1:-1][inner][0]
                notes.append(
                    f"{place}: {int(inner.sum())} unusable values of {name} filled in, first at t = {first:.3f} s"
                )
    return filled, bad


def _repetitions(place: str, repeated: Bool) -> str:
    return (
        f"{place}: {int(repeated.sum())} of {len(repeated)} rows left out, which repeat the positions of the row "
        "before: the log is faster than the controller's samples"
    )


def _restamped(place: str, most: float, exact: bool) -> str:
    """Note on rows whose stamps are up to ``most`` s from the times of their samples."""
    less = "" if exact else "; elasticity, backlash, delays and contacts, which need exact times, cannot be found"
    return (
        f"{place}: rows were sampled up to {1e3 * most:.1f} ms from their stamps, as the positions show: their own "
        f"times are used{less}"
    )


def _rising(place: str, time: Float, rows: NDArray[np.int64]) -> tuple[Bool, list[str]]:
    """Mask (R,) of the rows that have a time of their own, and notes."""
    valid = np.isfinite(time)
    valid[valid] = np.diff(time[valid], prepend=-np.inf) != 0
    lost = len(time) - int(valid.sum())
    if len(time) < LEAST_ROWS or lost > max(1, FEW * len(time)):
        reason = f"only {len(time)} rows" if len(time) < LEAST_ROWS else f"{lost} of {len(time)} rows have no new time"
        raise RecordingError(f"{place}: {reason}: record at least some seconds, each row with its own time")
    steps = np.diff(time[valid])
    if np.any(steps < 0):
        i = int(np.argmax(steps < 0))
        before, after = time[valid][i], time[valid][i + 1]
        raise RecordingError(
            f"{place}: the time goes back from {before:.3f} to {after:.3f} s in row {rows[valid][i + 1]}: "
            "give consecutive recordings as separate files"
        )
    return valid, [f"{place}: {lost} rows without a time of their own left out"] if lost else []


def _in_seconds(place: str, time: Float) -> None:
    steps = np.diff(time)
    step = float(np.median(steps))
    if step > COUNTED and np.all(time == np.round(time)):
        raise RecordingError(
            f"{place}: the time rises by {step:.6g} from row to row, in whole numbers: is it in milliseconds, or a row "
            "number? It must be in seconds, or have its unit in its name, as t [ms], or in --columns 't [ms]=YOURS'"
        )
    if step > SLOWEST:
        raise RecordingError(
            f"{place}: the time rises by {step:.6g} from row to row: in seconds that is too slow for the motion of an "
            "arm, record at least twice a second; if it is in milliseconds, divide it by 1000"
        )


def _glitches(time: Float, values: Float, kind: Kind) -> Bool:
    """True (R,) at single or paired values that no motion reaches, judged by the median of five.

    A torque or velocity must also exceed all those that last longer.
    """
    clean = np.interp(np.arange(len(values)), np.flatnonzero(~np.isnan(values)), values[~np.isnan(values)])
    middle = median_filter(clean, 5, mode="mirror")
    step, largest = float(np.median(np.diff(time))), float(np.max(np.abs(np.diff(middle))))
    least, dense = max(JITTER, JERKED * step), step <= DENSE
    if kind != "position":
        least = float(np.max(np.abs(middle))) if largest and dense else np.inf
    wild: Bool = np.isnan(values) | (np.abs(clean - middle) > max(GLITCH[not dense] * largest, least))
    return wild


def _few_enough(place: str, name: str, time: Float, wrong: Bool) -> None:
    if not _few(time, wrong):
        raise RecordingError(
            f"{place}: column {_unusable(name, time, wrong)}, the longest stretch {_longest(time, wrong):.2f} s: "
            "record it again or cut the file there"
        )


def _unusable(name: str, time: Float, wrong: Bool) -> str:
    share = 100 * float(np.mean(wrong))
    return f"{name} has no usable number in {share:.1f} % of its rows, first at t = {time[wrong][0]:.3f} s"


def _lost(place: str, name: str, time: Float, wrong: Bool) -> str:
    """Note on a column without numbers in many rows: its sensor failed, or is read only now and then."""
    last = int(np.flatnonzero(~wrong)[-1])
    if last < len(time) - 1 and _few(time[: last + 1], wrong[: last + 1]):
        text = f"after t = {time[last]:.3f} s, to the end at {time[-1]:.3f} s: its sensor failed or was no longer read"
    else:
        text = f"in {100 * float(np.mean(wrong)):.1f} % of its rows, first at t = {time[wrong][0]:.3f} s"
    return f"{place}: {name} has no number {text}. These rows are not used for it"


def _few(time: Float, wrong: Bool) -> bool:
    """True if the missing values are few enough to be filled in."""
    one_row = HOLE * float(np.median(np.diff(time)))
    return bool(wrong.sum() <= max(1, FEW * len(wrong)) and _longest(time, wrong) <= max(LONGEST, one_row))


def _longest(time: Float, wrong: Bool) -> float:
    """The longest stretch without a number, s."""
    last = len(time) - 1
    return max((float(time[min(end, last)] - time[max(first - 1, 0)]) for first, end in stretches(wrong)), default=0.0)


def _line(time: Float) -> Float:
    return np.linspace(time[0], time[-1], len(time))


def _grid(place: str, time: Float, exact: bool, rows: NDArray[np.int64]) -> Float:
    """``time`` itself where it is even, else a grid at its median rate, or at its mean rate if it is not ``exact``."""
    if np.max(np.abs(time - _line(time))) <= EVEN * (time[-1] - time[0]) / (len(time) - 1):
        return time
    steps, middle = np.diff(time), float(np.median(np.diff(time)))
    if not exact:  # of a logger at another rate than the controller's
        middle = float(np.mean(steps[steps < HOLE * middle]))
    count = int((time[-1] - time[0]) / middle + 1e-6) + 1
    if count > SPARSE * len(time) and in_bursts(time):
        raise RecordingError(
            f"{place}: rows come several at once, {1e3 * middle:.2g} ms apart, and their positions do not show when "
            "they were sampled: record with the controller's time of each row"
        )
    if count > most_points(len(time)):
        i = int(np.argmax(steps))
        raise RecordingError(
            f"{place}: the time jumps from {time[i]:.3f} to {time[i + 1]:.3f} s in row {rows[i + 1]}: was the clock "
            "set? Give the recordings before and after the jump as separate files, or leave out the shorter one"
        )
    return np.asarray(time[0] + middle * np.arange(count), np.float64)


def _holes(time: Float, grid: Float) -> Bool:
    """True (N,) at grid points between two rows that are far apart."""
    steps = np.diff(time)
    row = np.clip(np.searchsorted(time, grid, side="right") - 1, 0, len(steps) - 1)
    middle = float(np.median(steps))
    near = np.minimum(grid - time[row], time[row + 1] - grid) < 0.5 * middle
    holes: Bool = (steps[row] > HOLE * middle) & ~near
    return holes


def with_sides(gaps: Bool, step: float) -> Bool:
    """``gaps`` (N,), one sample every ``step`` s, with the samples beside the long ones; see ``BESIDE``."""
    rows = max(1, round(BESIDE / step))
    sides: Bool = binary_dilation(binary_opening(gaps, np.ones(rows, np.bool_)), np.ones(2 * rows + 1, np.bool_))
    return gaps | sides
