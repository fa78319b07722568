"""Residual of one channel against what drives it, with what the model adds as a curve through the points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import plotly.graph_objects as go
from plotly.subplots import make_subplots

from cellwatt_plugins.mismatch.input.run import Bool, Float
from cellwatt_plugins.mismatch.report import words
from cellwatt_plugins.mismatch.report.style import BARE, FOUND, GRID, MODEL, NOISE, SIMULATION
from cellwatt_plugins.mismatch.report.trace import Trace, joint_of, mechanical_power, root, unroot
from cellwatt_plugins.mismatch.verdict.findings import Where

MOST_POINTS = 2000
"""In each panel and state."""
CURVE_CELLS, FEWEST = 44, 12
CURVE = "#b3123f"


@dataclass(frozen=True)
class Axis:
    """What a residual is drawn against; ``values`` (N,) over all recordings."""

    title: str
    values: Float
    ways: tuple[tuple[str, Bool], ...]
    """Masks of the samples (N,) that get a curve of their own, with the dash of its line."""
    rooted: bool = False
    """Cells of the curve narrow towards zero, where friction turns."""
    marked: tuple[float, float] | None = None
    """Where a finding sits."""


def draw(traces: Sequence[Trace], channel: str, floor: float, where: Where | None) -> dict[str, Any]:
    """Two panels: velocity and position of the joint; speed and mechanical power for the supply."""
    before, after, added = (
        np.concatenate(parts) for parts in zip(*((_differences(t, channel)) for t in traces), strict=True)
    )
    axes = _axes(traces, channel, where)
    figure = make_subplots(1, 2, shared_yaxes=True, horizontal_spacing=0.04)
    for col, axis in enumerate(axes, start=1):
        first = col == 1
        chosen = _some(np.isfinite(before) & np.isfinite(after) & np.isfinite(axis.values))
        for name, residual, colour in (
            ("measured − simulation", before, SIMULATION),
            ("measured − model", after, MODEL),
        ):
            figure.add_trace(_points(axis.values[chosen], residual[chosen], name, colour, first), row=1, col=col)
        for dash, part in axis.ways:
            figure.add_trace(_curve(axis, added, part, dash, first or dash != "solid"), row=1, col=col)
        figure.update_xaxes(row=1, col=col, title_text=axis.title, title_standoff=6, **GRID)
    unit = next(t.units[t.channels.index(channel)] for t in traces if channel in t.channels)
    figure.update_yaxes(**GRID)
    figure.update_yaxes(title_text=words.unit(unit), row=1, col=1)
    legend = {"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom", "itemsizing": "constant"}
    figure.update_layout(
        **BARE, height=330, margin={"l": 64, "r": 12, "t": 34, "b": 50}, legend=legend, shapes=_shapes(axes, floor)
    )
    drawn: dict[str, Any] = figure.to_plotly_json()
    return drawn


def _differences(trace: Trace, channel: str) -> tuple[Float, Float, Float]:
    """(N,) residual of the simulation, of the model, and what the model adds to the simulation."""
    added = trace.column(trace.model, channel) - trace.column(trace.simulation, channel)
    return trace.residual(channel, trace.simulation), trace.residual(channel, trace.model), added


def _axes(traces: Sequence[Trace], channel: str, where: Where | None) -> tuple[Axis, Axis]:
    joint = joint_of(channel)
    if joint is None:
        speed = np.concatenate([np.abs(t.velocity).max(axis=1) for t in traces])
        given = np.concatenate([mechanical_power(t) for t in traces])
        whole = (("solid", np.full(len(speed), True)),)
        return Axis("speed of the fastest joint, rad/s", speed, whole), Axis("mechanical power Σ τ·ω, W", given, whole)
    velocity = np.concatenate([t.velocity[:, joint - 1] for t in traces])
    position = np.concatenate([t.position[:, joint - 1] for t in traces])
    slow = 0.02 * float(np.nanmax(np.abs(velocity), initial=0.0))
    ways = (("solid", velocity > slow), ("dash", velocity < -slow))
    every = (("solid", np.full(len(velocity), True)),)
    own = where if where is not None and channel in where.channels else Where((channel,))
    return (
        Axis(f"velocity of joint {joint}, rad/s", velocity, every, True, own.velocity),
        Axis(f"position of joint {joint}, rad", position, ways, False, own.position),
    )


def _some(good: Any) -> Any:
    """Indices of at most ``MOST_POINTS`` samples, spread at random so that no rhythm of the motion shows."""
    index = np.flatnonzero(good)
    if len(index) <= MOST_POINTS:
        return index
    return np.sort(np.random.default_rng(0).choice(index, MOST_POINTS, replace=False))


def _points(x: Float, y: Float, name: str, colour: str, legend: bool) -> go.Scatter:
    marker = {"color": colour, "size": 4, "opacity": 0.4}
    return go.Scatter(
        x=[float(f"{v:.4g}") for v in x],
        y=[float(f"{v:.4g}") for v in y],
        name=name,
        legendgroup=name,
        showlegend=legend,
        mode="markers",
        marker=marker,
        hoverinfo="skip",
    )


def _curve(axis: Axis, added: Float, part: Bool, dash: str, legend: bool) -> go.Scatter:
    """Median of what the model adds in each cell along the axis."""
    good = part & np.isfinite(axis.values) & np.isfinite(added)
    x, y = axis.values[good], added[good]
    warp, back = (root, unroot) if axis.rooted else (np.asarray, np.asarray)
    ends = warp(np.array([x.min(), x.max()])) if len(x) else np.array([0.0, 1.0])
    edges = back(np.linspace(ends[0], ends[1], CURVE_CELLS + 1))
    cell = np.clip(np.searchsorted(edges, x, side="right") - 1, 0, len(edges) - 2)
    order = np.argsort(cell, kind="stable")
    groups = np.split(y[order], np.searchsorted(cell[order], np.arange(1, len(edges) - 1)))
    name = "what the model adds" if dash == "solid" else "the same, moving backward"
    middle = [round(float(np.median(g)), 4) if len(g) >= FEWEST else None for g in groups]
    return go.Scatter(
        x=((edges[:-1] + edges[1:]) / 2).round(5).tolist(),
        y=middle,
        name=name,
        legendgroup=name,
        showlegend=legend,
        mode="lines",
        line={"color": CURVE, "width": 2.5, "dash": dash},
    )


def _shapes(axes: Sequence[Axis], floor: float) -> list[dict[str, Any]]:
    shapes: list[dict[str, Any]] = []
    for i, axis in enumerate(axes):
        n = "" if i == 0 else "2"
        if np.isfinite(floor):
            box = {"xref": f"x{n} domain", "yref": "y", "x0": 0, "x1": 1, "y0": -2 * floor, "y1": 2 * floor}
            shapes.append({"type": "rect", **box, "fillcolor": NOISE, "opacity": 0.22})
        if axis.marked:
            ends = {"x0": axis.marked[0], "x1": axis.marked[1], "y0": 0, "y1": 1}
            shapes.append(
                {"type": "rect", "xref": f"x{n}", "yref": f"y{n} domain", **ends, "fillcolor": FOUND, "opacity": 0.13}
            )
    return [{**s, "line": {"width": 0}, "layer": "below"} for s in shapes]
