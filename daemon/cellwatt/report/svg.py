"""Draws a figure of curves as SVG, for pages without plotly: small, and visible without scripts."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape

from cellwatt.report.blocks import Html
from cellwatt.report.drawing import plain
from cellwatt.report.figure import Figure, Json, Panel

WIDTH = 1070
"""Width of a figure, pixels."""
_GAP, _TITLE, _FOOT = 14, 20, 40
"""Space, pixels, between panels, above a panel with a title, and below the last panel."""
_LINE = 15
"""Height of a line of the legend, pixels."""
_DASHES = {"dot": "2 3", "dash": "6 4"}

Span = tuple[float, float]


@dataclass(frozen=True)
class Drawn:
    """A figure with one column of panels of lines, stripes, vertical lines and labels; the legend is beside it."""

    figure: Figure

    def html(self) -> Html:
        """Its markup; names of traces and labels are escaped already."""
        panels = [row[0] for row in self.figure.rows]
        left, right = self.figure.sides
        top, parts = 4.0, list[str]()
        for number, (panel, height) in enumerate(zip(panels, self.figure.heights, strict=True), 1):
            top += _TITLE * bool(panel.title)
            parts += _panel(panel, (left, WIDTH - right), (top, top + height), last=number == len(panels))
            top += height + _GAP
        size = f'viewBox="0 0 {WIDTH} {top + _FOOT:.0f}" width="100%"'
        style = "font-family:inherit;font-size:12px;fill:currentColor"
        head = f'<svg role=img aria-label="{escape(self.figure.label)}" {size} style="{style}">'
        return Html(f"<div class=wide>{head}{''.join(parts)}</svg></div>")


def _panel(panel: Panel, wide: Span, high: Span, *, last: bool) -> Iterator[str]:
    """One panel within ``wide`` and ``high``, pixels; the last panel shows the axis title."""
    (left, right), (top, bottom) = wide, high
    lines = [_points(trace) for trace in panel.traces]
    x = _padded(panel.x.span or [at for points in lines for at, _ in points], 0.0)  # a span of one frame has no length
    y = panel.y.span or _padded([up for points in lines for _, up in points if up is not None], 0.06)

    def at(value: float) -> float:
        return left + (right - left) * (value - x[0]) / (x[1] - x[0])

    def up(value: float, span: Span = y) -> float:
        return bottom - (bottom - top) * (value - span[0]) / (span[1] - span[0])

    grid = 'stroke="currentColor" stroke-opacity="0.15"'
    box = f'x="{left}" y="{top:.0f}" width="{right - left}" height="{bottom - top:.0f}"'
    if panel.title:
        yield _words(escape(panel.title), left, top - 6, 'font-weight="600"')
    for value, text in _ticks(*y, 4):
        yield _line((left, right), (up(value), up(value)), grid)
        yield _words(text, left - 6, up(value) + 4, 'text-anchor="end"')
    for value, text in _ticks(*x, 10):
        yield _line((at(value), at(value)), (top, bottom), grid)
        if last:
            yield _words(text, at(value), bottom + 16, 'text-anchor="middle"')
    if last:
        yield _words(escape(panel.x.title), (left + right) / 2, bottom + 34, 'text-anchor="middle"')
    yield f'<clipPath id="clip-{top:.0f}"><rect {box}/></clipPath><g clip-path="url(#clip-{top:.0f})">'
    for mark in (mark for mark in panel.marks if "text" not in mark):
        ends, height = (at(mark["x0"]), at(mark["x1"])), (up(mark["y1"], (0, 1)), up(mark["y0"], (0, 1)))
        if mark["type"] == "line":
            yield _line(ends, height, _stroke(mark["line"]))
        else:
            position = f'x="{ends[0]:.1f}" y="{height[0]:.1f}" width="{ends[1] - ends[0]:.1f}"'
            shade = f'height="{height[1] - height[0]:.1f}" fill="{mark["fillcolor"]}" opacity="{mark["opacity"]}"'
            yield f"<rect {position} {shade}/>"
    for trace, points in zip(panel.traces, lines, strict=True):
        path = _path([(at(position), None if value is None else up(value)) for position, value in points])
        yield f'<path d="{path}" fill="none" {_stroke(trace["line"])}/>'
    yield "</g>"
    for mark in (mark for mark in panel.marks if "text" in mark and x[0] <= mark["x"] <= x[1]):
        style = f'text-anchor="middle" font-size="10" fill="{mark["font"].get("color", "currentColor")}"'
        yield _words(mark["text"], at(mark["x"]), up(mark["y"], (0, 1)), style)
    for row, trace in enumerate(panel.traces[: max(int((bottom - top) / _LINE), 1)]):
        place_y = top + 10 + _LINE * row
        colour = trace["line"]["color"]
        yield f'<rect x="{right + 10}" y="{place_y - 6:.0f}" width="14" height="3" fill="{colour}"/>'
        yield _words(trace["name"], right + 29, place_y, 'font-size="10"')


def _words(text: str, x: float, y: float, style: str) -> str:
    return f'<text x="{x:.1f}" y="{y:.1f}" {style}>{text}</text>'


def _line(x: Span, y: Span, style: str) -> str:
    return f'<line x1="{x[0]:.1f}" x2="{x[1]:.1f}" y1="{y[0]:.1f}" y2="{y[1]:.1f}" {style}/>'


def _stroke(style: Json) -> str:
    dashes = f' stroke-dasharray="{_DASHES[style["dash"]]}"' if style.get("dash") in _DASHES else ""
    return f'stroke="{style["color"]}" stroke-width="{style["width"]}"{dashes}'


def _points(trace: Json) -> list[tuple[float, float | None]]:
    """The points of a line; ``None`` is a gap."""
    y: Sequence[float | None] = trace["y"]
    x = trace["x"] if "x" in trace else (trace["x0"] + trace["dx"] * i for i in range(len(y)))
    return list(zip(x, y, strict=True))


def _path(points: Sequence[tuple[float, float | None]]) -> str:
    out, pen = [], "M"
    for x, y in points:
        if y is not None:
            out.append(f"{pen}{x:.1f} {y:.1f}")
        pen = "M" if y is None else "L"
    return "".join(out)


def _padded(values: Sequence[float], share: float) -> Span:
    """Limits of an axis for ``values``, with a margin of ``share`` of their range."""
    low, high = min(values, default=0.0), max(values, default=1.0)
    room = (high - low) * share or max(abs(high), 1e-9) * 0.1 * (high == low)
    return low - room, high + room


def _ticks(low: float, high: float, about: int) -> Iterator[tuple[float, str]]:
    """Round positions on an axis, and their texts."""
    rough = (high - low) / about
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * m for m in (1, 2, 5, 10) if power * m >= rough * 0.999)
    decimals = max(-math.floor(math.log10(step)), 0)
    for n in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1):
        yield n * step, f"{plain([n * step], decimals)[0] + 0.0:.{decimals}f}".replace("-", "−")
