"""Place of the mismatch: residual ÷ noise floor by joint and velocity, joint and position, channel and time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from cellwatt.report import Axis, Figure, Panel, drawing
from cellwatt.report.figure import Json
from cellwatt_plugins.mismatch.input.run import Float
from cellwatt_plugins.mismatch.report.trace import Trace, joint_of, root, unroot

VELOCITY_CELLS, POSITION_CELLS, TIME_CELLS = 41, 48, 180
ROW = 24
"""Pixels."""
MOST_NAMES = 8
"""Of recordings below the time strip."""
FEWEST = 20
"""Samples that a cell needs to be shown."""
LOWEST, HIGHEST = 3.0, 5.0
"""Colours end between 2^3 and 2^5 noise floors: chance stays grey, and one large residual does not hide the rest."""
STATES = ("simulation", "refit", "model")


@dataclass(frozen=True)
class Strip:
    """Rows of cells: ``ratio`` (rows, cells) is rms residual ÷ noise floor, NaN where there are too few samples."""

    rows: tuple[str, ...]
    places: Float
    """(cells,) where each cell is drawn."""
    ratio: Float
    labels: tuple[str, ...]
    """Span of each cell, in words."""


def rms_by_cell(residual: Float, cell: Float, cells: int) -> Float:
    """(cells,) rms of (N,) ``residual`` by (N,) ``cell`` number; NaN residuals and cells outside are left out."""
    good = np.isfinite(residual) & np.isfinite(cell) & (cell >= 0) & (cell < cells)
    index = cell[good].astype(np.intp)
    count = np.bincount(index, minlength=cells)
    total = np.bincount(index, weights=residual[good] ** 2, minlength=cells)
    return np.where(count >= FEWEST, np.sqrt(total / np.maximum(count, 1)), np.nan)


def by_coordinate(traces: Sequence[Trace], which: str, floors: dict[str, float], coordinate: str) -> Strip:
    """Torque channels over their joint's own ``velocity`` or ``position``."""
    signed = coordinate == "velocity"
    warp = root if signed else np.asarray
    cells = VELOCITY_CELLS if signed else POSITION_CELLS
    values = np.concatenate([warp(getattr(t, coordinate)).ravel() for t in traces])
    values = values[np.isfinite(values)]
    low, high = (float(values.min()), float(values.max())) if len(values) else (-1.0, 1.0)
    low, high = (-max(-low, high), max(-low, high)) if signed else (low, high)
    edges = np.linspace(low, high if high > low else low + 1.0, cells + 1)
    rows = tuple(c for c in floors if joint_of(c) is not None)
    ratio = np.full((len(rows), cells), np.nan)
    for r, channel in enumerate(rows):
        own = (joint_of(channel) or 1) - 1
        residual = np.concatenate([t.residual(channel, getattr(t, which)) for t in traces])
        along = np.concatenate([warp(getattr(t, coordinate)[:, own]) for t in traces])
        cell = np.clip(np.floor((along - edges[0]) / (edges[1] - edges[0])), None, cells - 1)
        ratio[r] = rms_by_cell(residual, cell, cells) / floors[channel]
    true = unroot(edges) if signed else edges
    unit = f"{_lengths(traces)}/s" if signed else _lengths(traces)
    labels = tuple(f"{a:.3g} to {b:.3g} {unit}" for a, b in pairwise(true))
    return Strip(rows, (edges[:-1] + edges[1:]) / 2, ratio, labels)


def by_time(traces: Sequence[Trace], which: str, floors: dict[str, float]) -> tuple[Strip, list[tuple[float, str]]]:
    """All channels over time, runs side by side with an empty cell between; with the middle and name of each run."""
    lengths = np.array([max(len(t.time) * t.step, 1e-9) for t in traces])
    shares = np.maximum(np.round(TIME_CELLS * lengths / lengths.sum()), 6).astype(int)
    parts, labels, middles, place = [], [], [], 0
    for trace, cells in zip(traces, shares, strict=True):
        cell = np.floor(np.arange(len(trace.time)) * cells / max(len(trace.time), 1))
        block = [rms_by_cell(trace.residual(c, getattr(trace, which)), cell, cells) / f for c, f in floors.items()]
        parts += [np.array(block), np.full((len(floors), 1), np.nan)]
        start = float(trace.time[0]) if len(trace.time) else 0.0
        wide = len(trace.time) * trace.step / cells
        spans = [f"{start + i * wide:.1f} to {start + (i + 1) * wide:.1f} s" for i in range(cells)]
        labels += [*(f"{trace.name}, {s}" for s in spans), ""]
        middles.append((place + (cells - 1) / 2, trace.name))
        place += cells + 1
    ratio = np.concatenate(parts[:-1], axis=1)
    return Strip(tuple(floors), np.arange(ratio.shape[1], dtype=np.float64), ratio, tuple(labels[:-1])), middles


def colour_range(traces: Sequence[Trace], floors: dict[str, float]) -> float:
    """Upper end of the colours in powers of two, the same for all states so that they compare."""
    strips = [by_time(traces, which, floors)[0].ratio for which in STATES]
    known = np.concatenate([s[np.isfinite(s)] for s in strips])
    return float(np.clip(np.ceil(np.log2(known.max())), LOWEST, HIGHEST)) if len(known) and known.max() > 0 else LOWEST


def _lengths(traces: Sequence[Trace]) -> str:
    """Unit of the joints' positions: rad, m of linear axes, both where the arm has both."""
    units = {t.units[i] for t in traces for i, c in enumerate(t.channels) if joint_of(c) is not None}
    return {frozenset({"N"}): "m", frozenset({"N", "N*m"}): "(rad or m)"}.get(frozenset(units), "rad")


def draw(traces: Sequence[Trace], which: int, floors: dict[str, float], top: float) -> Figure:
    """The three strips of one of ``STATES``."""
    state = STATES[which]
    velocity, position = (by_coordinate(traces, state, floors, c) for c in ("velocity", "position"))
    time, middles = by_time(traces, state, floors)
    shown = dict(middles[:: -(-len(middles) // MOST_NAMES)])
    rows, length = Axis(names=True, grid=False), _lengths(traces)
    upper = [
        Panel([_cells(velocity)], Axis(f"joint velocity, {length}/s", ticks=_speed_marks(velocity), grid=False), rows),
        Panel([_cells(position)], Axis(f"joint position, {length}", grid=False), replace(rows, labels=False)),
    ]
    lower = [Panel([_cells(time)], Axis("time, recordings side by side", ticks=shown, grid=False), rows)]
    heights = ROW * max(len(velocity.rows), 1), ROW * len(time.rows)
    powers = range(int(top) + 1)
    layout = drawing.colours(top, "÷ noise", powers, [f"{2**power}×" for power in powers])
    label = f"Residual of the {state} in noise floors by joint velocity, joint position and time"
    return Figure(label, [upper, lower], heights, legend=False, sides=(64, 80), layout=layout, when=("state", which))


def _speed_marks(strip: Strip) -> dict[float, str]:
    """Ticks of the velocity axis, which is drawn by its signed root."""
    speeds = [s for s in (0.1, 0.5, 1.0, 2.0, 4.0, 8.0) if s <= float(strip.places[-1]) ** 2]
    marks = np.array([*(-s for s in reversed(speeds)), 0.0, *speeds])
    return dict(zip(root(marks).tolist(), [f"{m:g}".replace("-", "−") for m in marks], strict=True))


def _cells(strip: Strip) -> Json:
    with np.errstate(divide="ignore", invalid="ignore"):
        shade = np.maximum(np.log2(strip.ratio), 0.0)
    rows = [f"joint {joint}" if (joint := joint_of(c)) is not None else c for c in strip.rows]
    said = [
        [f"{label}\n{r:.1f} × noise floor" for label, r in zip(strip.labels, row, strict=True)] for row in strip.ratio
    ]
    return drawing.cells(strip.places, rows, shade, said)
