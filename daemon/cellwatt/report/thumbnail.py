"""A small drawing of a page's first figure: its largest panel as SVG, without axes and text."""

from __future__ import annotations

import base64
import json
import re
import zlib
from html import escape
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.report.blocks import Html
from cellwatt.report.drawing import thin
from cellwatt.report.theme import BAD, MEASURED

Float = NDArray[np.float64]
Json = dict[str, Any]

LARGEST: Final = 1 << 26
"""Bytes of a figure, unpacked."""
WIDTH, HEIGHT, MARGIN = 200, 90, 4
MOST_POINTS, MOST_DOTS = 240, 150
_FIRST: Final = re.compile(r"<figure [^>]*><script type=text/plain>(.*?)</script>", re.DOTALL)


def thumbnail(page: str) -> Html:
    """The drawing for the text of a page; empty where it has no figure of curves, dots, bars or cells.

    Raises ``ValueError`` where the figure is not what cellwatt draws: a page may be anybody's.
    """
    found = _FIRST.search(page)
    if found is None:
        return Html("")
    try:
        unpacking = zlib.decompressobj(zlib.MAX_WBITS | 16)
        return drawn(json.loads(unpacking.decompress(base64.b64decode(found[1]), LARGEST)))
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError, zlib.error) as error:
        raise ValueError("its first figure cannot be read") from error


def drawn(figure: Json) -> Html:
    """The largest panel of a figure in the form of ``Figure.plotly``."""
    axis = _largest(figure)
    traces = [t for t in figure["data"] if t["xaxis"] == f"x{axis}"]
    frame = _Frame(figure["layout"], axis, traces)
    marks = "".join(_DRAW[t["type"]](t, frame) for t in traces)
    return Html(f'<svg viewBox="0 0 {WIDTH} {HEIGHT}" aria-hidden=true>{marks}</svg>' if marks else "")


def _largest(figure: Json) -> int:
    """Number of the panel with most room, the first of equals."""
    layout = figure["layout"]

    def room(axis: int) -> float:
        sides = (layout[_key(letter, axis)]["domain"] for letter in "xy")
        return float(np.prod([high - low for low, high in sides]))

    return max(sorted({int(t["xaxis"][1:]) for t in figure["data"]} or {1}), key=room)


def _key(letter: str, axis: int) -> str:
    return f"{letter}axis{axis if axis > 1 else ''}"


class _Frame:
    """Places of a panel's values in the drawing."""

    def __init__(self, layout: Json, axis: int, traces: list[Json]) -> None:
        self._axes = {letter: layout[_key(letter, axis)] for letter in "xy"}
        rows = (name for t in traces if t["type"] != "scatter" for name in t["y"])
        self._rows = {name: row for row, name in enumerate(dict.fromkeys(rows))}
        self.row = (HEIGHT - 2 * MARGIN) / max(len(self._rows), 1)
        self.stacked: dict[str, float] = {}
        self._span = {letter: self._ends(letter, traces) for letter in "xy"}

    def x(self, values: Any) -> Float:
        """Pixels from the left."""
        return MARGIN + self._share("x", values) * (WIDTH - 2 * MARGIN)

    def y(self, values: Any) -> Float:
        """Pixels from the top; names of rows are at their middle."""
        if self._rows:
            return np.array([MARGIN + (self._rows.get(v, -9) + 0.5) * self.row for v in values])
        return HEIGHT - MARGIN - self._share("y", values) * (HEIGHT - 2 * MARGIN)

    def _share(self, letter: str, values: Any) -> Float:
        low, high = self._span[letter]
        return (self._plain(letter, values) - low) / ((high - low) or 1.0)

    def _plain(self, letter: str, values: Any) -> Float:
        array = np.array([np.nan if v is None else v for v in values], np.float64)
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.log10(array) if self._axes[letter].get("type") == "log" else array

    def _ends(self, letter: str, traces: list[Json]) -> tuple[float, float]:
        given = self._axes[letter].get("range")
        if given is not None:
            return float(given[0]), float(given[1])
        if letter == "y" and self._rows:
            return 0.0, 1.0
        values = [self._plain(letter, _xs(t) if letter == "x" else t["y"]) for t in traces]
        known = np.concatenate([*values, np.zeros(0)])
        known = known[np.isfinite(known)]
        return (float(known.min()), float(known.max())) if len(known) else (0.0, 1.0)


def _xs(trace: Json) -> Any:
    if "x" in trace:
        return trace["x"]
    return trace["x0"] + trace["dx"] * np.arange(len(trace["y"]))


def _scatter(trace: Json, frame: _Frame) -> str:
    x, y = frame.x(_xs(trace)), frame.y(trace["y"])
    out = ""
    if "lines" in trace["mode"] and trace["line"].get("width", 1):
        colour = escape(str(trace["line"]["color"]))
        out += f'<path d="{_path(x, y)}" fill="none" stroke="{colour}" stroke-width="1.2"/>'
    if "markers" in trace["mode"]:
        style = trace["marker"] if "marker" in trace else trace["line"]
        colour = style["color"] if isinstance(style["color"], str) else MEASURED
        known = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
        chosen = known[:: max(-(-len(known) // MOST_DOTS), 1)]
        dots = "".join(f"M{x[i]:.0f} {y[i]:.0f}h.1" for i in chosen)
        line = f'stroke="{escape(colour)}" stroke-width="3" stroke-linecap="round"'
        out += f'<path d="{dots}" fill="none" {line}/>' if dots else ""
    return out


def _path(x: Float, y: Float) -> str:
    """A line through points, left of which some are thinned out and gaps are kept."""
    if len(y) > MOST_POINTS:
        y, apart = thin(y, MOST_POINTS)
        x = np.interp(apart * np.arange(len(y)), np.arange(len(x)), x)
    words, pen = [], "M"
    for left, top in zip(x, y, strict=True):
        if not np.isfinite(left) or not np.isfinite(top):
            pen = "M"
            continue
        words.append(f"{pen}{left:.0f} {top:.0f}")
        pen = "L"
    return "".join(words)


def _bars(trace: Json, frame: _Frame) -> str:
    colour, out = escape(trace["marker"]["color"]), []
    for name, size, top in zip(trace["y"], trace["x"], frame.y(trace["y"]), strict=True):
        start = frame.stacked.get(name, 0.0)
        frame.stacked[name] = end = start + (size or 0.0)
        left, right = frame.x([start, end])
        out.append(_box(left, right, top, frame.row, colour))
    return "".join(out)


def _cells(trace: Json, frame: _Frame) -> str:
    shades = np.array([[np.nan if v is None else v for v in row] for row in trace["z"]], np.float64)
    most = np.nanmax(shades, initial=0.0)
    x = frame.x(trace["x"])
    half = float(np.median(np.diff(x))) / 2 if len(x) > 1 else WIDTH / 2
    out = []
    for top, row in zip(frame.y(trace["y"]), shades, strict=True):
        dark = np.flatnonzero(row > max(most, 1e-9) / 10)
        out += [_box(x[i] - half, x[i] + half, top, frame.row, BAD, row[i] / most) for i in dark]
    return "".join(out)


def _box(left: float, right: float, middle: float, height: float, colour: str, opacity: float = 1.0) -> str:
    place = f'x="{min(left, right):.1f}" width="{abs(right - left):.1f}" y="{middle - 0.4 * height:.1f}"'
    return f'<rect {place} height="{0.8 * height:.1f}" fill="{colour}" fill-opacity="{opacity:.2f}"/>'


_DRAW: Final = {"scatter": _scatter, "bar": _bars, "heatmap": _cells}
