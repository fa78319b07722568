"""Residual of one channel against the quantities on which it depends, with the model's contribution as a curve."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cellwatt.arrays import Bool, Float
from cellwatt.report import Axis, Figure, Panel
from cellwatt.report.drawing import band, dots, line, stretch
from cellwatt.report.figure import Json
from cellwatt.report.numbers import unit
from cellwatt.report.theme import CURVE, FOUND, MODEL, NOISE, SIMULATION
from cellwatt_plugins.explain.report import wording
from cellwatt_plugins.explain.report.trace import Trace, joint_of, mechanical_power, root, unroot
from cellwatt_plugins.explain.verdict.findings import Where

CURVE_CELLS, FEWEST = 44, 12


@dataclass(frozen=True)
class Coordinate:
    """Quantity on the horizontal axis; ``values`` (N,) over all recordings."""

    title: str
    values: Float
    ways: tuple[tuple[str, Bool], ...]
    """Masks (N,) of the samples of each curve, with the dash of its line."""
    rooted: bool = False
    """True if the curve's cells narrow towards zero, where friction reverses."""
    marked: tuple[float, float] | None = None
    """Range of a finding, in the unit of the axis."""


def draw(traces: Sequence[Trace], channel: str, floor: float, where: Where | None) -> Figure:
    """Two panels: velocity and position for a joint; speed and mechanical power for the supply."""
    before, after = (
        np.concatenate([t.residual(channel, getattr(t, which)) for t in traces]) for which in ("simulation", "model")
    )
    added = before - after
    symbol = unit(next(t.units[t.channels.index(channel)] for t in traces if channel in t.channels))
    panels = [_panel(axis, before, after, added, floor, symbol) for axis in _axes(traces, channel, where)]
    label = f"Residual of {wording.channel_name(channel)} against what it depends on, before and after the model"
    return Figure(label, [panels], (246,), "y")


def _panel(axis: Coordinate, before: Float, after: Float, added: Float, floor: float, symbol: str) -> Panel:
    known = np.isfinite(before) & np.isfinite(after)
    pairs = (("measured − simulation", before, SIMULATION), ("measured − model", after, MODEL))
    points = [
        {**dots(name, np.where(known, axis.values, np.nan), residual, colour), "hoverinfo": "skip"}
        for name, residual, colour in pairs
    ]
    curves = [_curve(axis, added, part, dash) for dash, part in axis.ways]
    marks = band(-2 * floor, 2 * floor, NOISE)
    marks += [stretch(*axis.marked, FOUND)] if axis.marked else []
    return Panel([*points, *curves], Axis(axis.title), Axis(symbol), marks)


def _axes(traces: Sequence[Trace], channel: str, where: Where | None) -> tuple[Coordinate, Coordinate]:
    joint = joint_of(channel)
    if joint is None:
        speed = np.concatenate([np.abs(t.velocity).max(axis=1) for t in traces])
        given = np.concatenate([mechanical_power(t) for t in traces])
        whole = (("solid", np.full(len(speed), True)),)
        fastest = Coordinate("speed of the fastest joint, rad/s", speed, whole)
        return fastest, Coordinate("mechanical power Σ τ·ω, W", given, whole)
    velocity = np.concatenate([t.velocity[:, joint - 1] for t in traces])
    position = np.concatenate([t.position[:, joint - 1] for t in traces])
    slow = 0.02 * float(np.nanmax(np.abs(velocity), initial=0.0))
    ways = (("solid", velocity > slow), ("dash", velocity < -slow))
    every = (("solid", np.full(len(velocity), True)),)
    linear = any(t.units[t.channels.index(channel)] == "N" for t in traces if channel in t.channels)
    length = "m" if linear else "rad"
    own = where if where is not None and channel in where.channels else Where((channel,))
    return (
        Coordinate(f"velocity of joint {joint}, {length}/s", velocity, every, True, own.velocity),
        Coordinate(f"position of joint {joint}, {length}", position, ways, False, own.position),
    )


def _curve(axis: Coordinate, added: Float, part: Bool, dash: str) -> Json:
    """Median of the model's contribution in each cell along the axis."""
    good = part & np.isfinite(axis.values) & np.isfinite(added)
    x, y = axis.values[good], added[good]
    warp, back = (root, unroot) if axis.rooted else (np.asarray, np.asarray)
    ends = warp(np.array([x.min(), x.max()])) if len(x) else np.array([0.0, 1.0])
    edges = back(np.linspace(ends[0], ends[1], CURVE_CELLS + 1))
    cell = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    order = np.argsort(cell, kind="stable")
    groups = np.split(y[order], np.searchsorted(cell[order], np.arange(1, len(edges) - 1)))
    name = "what the model adds" if dash == "solid" else "the same, moving backward"
    middle = [float(np.median(g)) if len(g) >= FEWEST else np.nan for g in groups]
    return line(name, (edges[:-1] + edges[1:]) / 2, middle, CURVE, dash=dash, width=2.5)
