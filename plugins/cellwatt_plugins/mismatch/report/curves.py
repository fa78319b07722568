"""One channel of one recording over time: measured, simulation and model; below, what is left of the difference."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from plotly.subplots import make_subplots

from cellwatt_plugins.mismatch.input.run import Float
from cellwatt_plugins.mismatch.report import words
from cellwatt_plugins.mismatch.report.style import BARE, FOUND, GRID, MEASURED, MODEL, NOISE, SIMULATION
from cellwatt_plugins.mismatch.report.trace import Trace, spans, telling_stretch, thin
from cellwatt_plugins.mismatch.verdict.findings import Span

CURVES = 5
"""In each figure."""
OPENING = 20.0
"""Seconds shown at first, or more where the thinned curve would have fewer than ``OPENING_POINTS`` there."""
OPENING_POINTS = 900
MOST_MARKS = 80


def draw(trace: Trace, channel: str, floor: float, found: Sequence[Span], points: int) -> dict[str, Any]:
    """``found``: stretches where findings on this channel sit; ``points``: most per curve.

    The curves are plain values: plotly would check every number of the millions that a page holds.
    """
    figure = make_subplots(2, 1, shared_xaxes=True, row_heights=[0.6, 0.4], vertical_spacing=0.05)
    unit = words.unit(trace.units[trace.channels.index(channel)])
    figure.update_yaxes(title_text=unit, **GRID)
    figure.update_xaxes(**GRID)
    figure.update_xaxes(title_text="s", title_standoff=4, row=2, col=1, range=_opening(trace, channel, points))
    figure.update_layout(
        **BARE,
        height=400,
        margin={"l": 64, "r": 12, "t": 34, "b": 42},
        hovermode="x unified",
        shapes=[*_noise(floor), *_held_out(trace), *_found(trace, found)],
        legend={"orientation": "h", "x": 0, "y": 1.0, "yanchor": "bottom"},
    )
    simulation, model = trace.simulation, trace.model
    rows = (
        ("", "measured", trace.column(trace.measured, channel), MEASURED, 2.4),
        ("", "simulation", trace.column(simulation, channel), SIMULATION, 1.3),
        ("", "model", trace.column(model, channel), MODEL, 1.3),
        ("2", "measured − simulation", trace.residual(channel, simulation), SIMULATION, 1.1),
        ("2", "measured − model", trace.residual(channel, model), MODEL, 1.1),
    )
    digits = _digits(trace, channel, floor)
    data = [
        {
            **_curve(trace, values, points, digits),
            "xaxis": f"x{row}",
            "yaxis": f"y{row}",
            "name": name,
            "line": {"color": colour, "width": width},
        }
        for row, name, values, colour, width in rows
    ]
    return {"data": data, "layout": figure.layout.to_plotly_json()}


def _opening(trace: Trace, channel: str, points: int) -> list[float]:
    density = min(points / max(len(trace.time), 1), 1.0) / max(trace.step, 1e-9)
    start, end = telling_stretch(trace, channel, max(OPENING, OPENING_POINTS / density))
    return [round(start, 3), round(end, 3)]


def _digits(trace: Trace, channel: str, floor: float) -> int:
    """Decimals kept: a fiftieth of the noise, which the eye cannot tell from the whole."""
    if np.isfinite(floor) and floor > 0:
        return max(words.decimals_for(floor / 50, 1), 0)
    values = trace.column(trace.measured, channel)
    known = values[np.isfinite(values)]
    return max(words.decimals_for(float(np.ptp(known)) / 5000 if len(known) else 1.0, 1), 0)


def _curve(trace: Trace, values: Float, points: int, digits: int) -> dict[str, Any]:
    """Evenly spaced and rounded, so that the page stays small."""
    y, apart = thin(values, points)
    rounded = np.round(np.where(np.isfinite(y), y, np.nan), digits).tolist()
    heights = [None if v != v else v for v in rounded]
    start = round(float(trace.time[0]), 4)
    return {"type": "scatter", "mode": "lines", "y": heights, "x0": start, "dx": apart * trace.step}


def _noise(floor: float) -> list[dict[str, Any]]:
    """Band of ± 2 noise floors behind the residuals."""
    if not np.isfinite(floor):
        return []
    box = {"type": "rect", "xref": "x2 domain", "yref": "y2", "x0": 0, "x1": 1, "y0": -2 * floor, "y1": 2 * floor}
    return [{**box, "fillcolor": NOISE, "opacity": 0.22, "line": {"width": 0}, "layer": "below"}]


def _held_out(trace: Trace) -> list[dict[str, Any]]:
    """Shade where the parameters were not fitted."""
    if trace.held_out is None or trace.held_out.all():
        return []
    style = {"fillcolor": MODEL, "opacity": 0.07, "line": {"width": 0}, "layer": "below"}
    return [
        {"type": "rect", "xref": "x", "yref": "paper", **_between(trace, a, b), "y0": 0, "y1": 1, **style}
        for a, b in spans(trace.held_out)[:MOST_MARKS]
    ]


def _between(trace: Trace, first: int, last: int) -> dict[str, float]:
    return {"x0": round(float(trace.time[first]), 3), "x1": round(float(trace.time[last]), 3)}


def _found(trace: Trace, found: Sequence[Span]) -> list[dict[str, Any]]:
    """A bright edge above the residuals where a finding sits."""
    mine = [s for s in found if s.recording == trace.name][:MOST_MARKS]
    style = {"fillcolor": FOUND, "line": {"width": 0}, "layer": "below"}
    return [
        {"type": "rect", "xref": "x2", "yref": "y2 domain", "x0": s.start, "x1": s.end, "y0": 0.97, "y1": 1.0, **style}
        for s in mine
    ]
