"""Traces and marks of figures: curves, dots, bars, bands and cells, rounded and thinned to limit the page size."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from cellwatt.arrays import Float
from cellwatt.report.figure import Json
from cellwatt.report.numbers import decimals_for
from cellwatt.report.theme import HEAT

MOST_POINTS, MOST_DOTS = 4000, 2000
"""Largest number of points of one curve, and of one set of dots."""


def curve(
    name: str,
    values: ArrayLike,
    colour: str,
    *,
    start: float = 0.0,
    step: float = 1.0,
    width: float = 1.4,
    most: int = MOST_POINTS,
    decimals: int | None = None,
) -> Json:
    """A line through evenly spaced values (N,), the first at ``start``, thinned to ``most`` points."""
    y, apart = thin(np.asarray(values, np.float64), most)
    line = {"color": colour, "width": width}
    position = {"x0": round(start, 4), "dx": apart * step, "y": plain(y, decimals)}
    return {"type": "scatter", "mode": "lines", "name": escape(name), "line": line, **position}


def line(name: str, x: ArrayLike, y: ArrayLike, colour: str, *, dash: str = "solid", width: float = 1.6) -> Json:
    """A line through a few points (N,)."""
    style = {"color": colour, "width": width, "dash": dash}
    return {"type": "scatter", "mode": "lines", "name": escape(name), "line": style, "x": plain(x), "y": plain(y)}


def dots(
    name: str,
    x: ArrayLike,
    y: ArrayLike,
    colour: str,
    *,
    size: Any = 4,
    opacity: float = 0.4,
    symbol: str = "circle",
    hover: Sequence[str] = (),
) -> Json:
    """Points (N,), more than ``MOST_DOTS`` sampled at random, to avoid aliasing; ``hover``: tooltip of each."""
    at, up = np.asarray(x, np.float64), np.asarray(y, np.float64)
    known = np.flatnonzero(np.isfinite(at) & np.isfinite(up))
    if len(known) > MOST_DOTS:
        known = np.sort(np.random.default_rng(0).choice(known, MOST_DOTS, replace=False))
    marker = {"color": colour, "size": size, "opacity": opacity, "symbol": symbol}
    tooltips = {"text": list(map(escape, hover)), "hoverinfo": "text"} if hover else {}
    positions = {"x": plain(at[known]), "y": plain(up[known])}
    return {"type": "scatter", "mode": "markers", "name": escape(name), "marker": marker, **positions, **tooltips}


def ribbon(low: ArrayLike, high: ArrayLike, colour: str, start: float) -> list[Json]:
    """A band between two evenly spaced curves (N,)."""
    red, green, blue = (int(colour[i : i + 2], 16) for i in (1, 3, 5))
    edges = [curve("", values, colour, start=start, width=0, most=10**9) for values in (low, high)]
    filled = {**edges[1], "fill": "tonexty", "fillcolor": f"rgba({red},{green},{blue},0.25)"}
    return [{**edge, "hoverinfo": "skip"} for edge in (edges[0], filled)]


def bars(name: str, labels: Sequence[str], sizes: ArrayLike, colour: str, unit: str = "") -> Json:
    """Horizontal bars, one per label; several traces are stacked."""
    hover = f"%{{y}}, {escape(name)}: %{{x:.4g}} {escape(unit)}<extra></extra>"
    position = {"y": list(map(escape, labels)), "x": plain(sizes)}
    style = {"marker": {"color": colour}, "orientation": "h", "hovertemplate": hover}
    return {"type": "bar", "name": escape(name), **position, **style}


def cells(x: ArrayLike, rows: Sequence[str], shade: Float, tooltips: Sequence[Sequence[str]]) -> Json:
    """Rows of cells coloured by ``shade`` (rows, cells), blank if NaN; ``tooltips``: tooltip of each cell."""
    text = [[escape(each).replace("\n", "<br>") for each in row] for row in tooltips]
    content = {"x": plain(x, 4), "y": list(map(escape, rows)), "z": [plain(row, 2) for row in shade], "text": text}
    hover = {"hovertemplate": "%{y}, %{text}<extra></extra>", "coloraxis": "coloraxis", "ygap": 2}
    return {"type": "heatmap", **content, **hover}


def colours(top: float, title: str, ticks: Sequence[float], texts: Sequence[str]) -> Json:
    """Layout of the colour scale of ``cells``, from 0 to ``top``, with its colour bar."""
    bar: Json = {"title": {"text": title, "side": "right"}, "tickvals": list(ticks), "ticktext": list(texts)}
    bar |= {"thickness": 12, "outlinewidth": 0}
    return {"coloraxis": {"colorscale": HEAT, "cmin": 0, "cmax": top, "colorbar": bar}}


def band(low: float, high: float, colour: str) -> list[Json]:
    """A stripe over the whole width between two heights; [] if a height is not finite."""
    if not np.isfinite([low, high]).all():
        return []
    return [_box(("x domain", 0.0, 1.0), ("y", low, high), colour, 0.22)]


def stretch(
    start: float, end: float, colour: str, opacity: float = 0.13, ends: tuple[float, float] = (0.0, 1.0)
) -> Json:
    """A stripe from ``start`` to ``end`` on the x axis; ``ends``: its lower and upper end, as shares of the height."""
    return _box(("x", round(start, 3), round(end, 3)), ("y domain", *ends), colour, opacity)


def upright(x: float, colour: str) -> Json:
    """A dotted line over the whole height."""
    style = {"color": colour, "width": 1.5, "dash": "dot"}
    return {"type": "line", "xref": "x", "yref": "y domain", "x0": x, "x1": x, "y0": 0, "y1": 1, "line": style}


def note(text: str, x: float, y: float, colour: str = "", *, up: str = "y domain") -> Json:
    """A label at ``x``; ``y`` is a share of the height, or in the unit of the axis if ``up`` is "y"."""
    font = {"size": 10, **({"color": colour} if colour else {})}
    position = {"xref": "x", "yref": up, "x": x, "y": y, "yanchor": "bottom"}
    return {**position, "text": escape(text), "showarrow": False, "font": font}


def plain(values: ArrayLike, decimals: int | None = None) -> list[Any]:
    """Numbers (N,) for JSON: gaps are None; rounded to ``decimals``, by default to 1/5000 of their range."""
    array = np.asarray(values, np.float64)
    known = array[np.isfinite(array)]
    if decimals is None:
        span = float(np.ptp(known)) if len(known) else 0.0
        decimals = max(decimals_for((span or float(np.abs(known).max(initial=1.0))) / 5000, 1), 0)
    rounded = np.round(np.where(np.isfinite(array), array, np.nan), decimals)
    return [None if v != v else v for v in rounded.tolist()]


def thin(values: Float, most: int) -> tuple[Float, float]:
    """Thin ``values`` (N,) to at most ``most``, preserving extremes; return them and their spacing in samples.

    Each span yields its lowest and highest value in their original order, so a peak is never lost, and moves by at
    most half a span. A span without a finite value remains a gap.
    """
    count = len(values)
    if count <= most:
        return values, 1.0
    span = -(-count // (most // 2))
    padded = np.concatenate([values, np.full(-count % span, np.nan)]).reshape(-1, span)
    known = np.isfinite(padded)
    low = np.where(known, padded, np.inf).argmin(axis=1)
    high = np.where(known, padded, -np.inf).argmax(axis=1)
    rows = np.arange(len(padded))
    pairs = np.stack([padded[rows, np.minimum(low, high)], padded[rows, np.maximum(low, high)]], axis=1)
    return np.where(known.any(axis=1)[:, None], pairs, np.nan).ravel(), span / 2


def _box(along: tuple[str, float, float], up: tuple[str, float, float], colour: str, opacity: float) -> Json:
    position = {"xref": along[0], "x0": along[1], "x1": along[2], "yref": up[0], "y0": up[1], "y1": up[2]}
    style = {"fillcolor": colour, "opacity": opacity, "line": {"width": 0}, "layer": "below"}
    return {"type": "rect", **position, **style}
