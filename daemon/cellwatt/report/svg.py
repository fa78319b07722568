"""A figure of curves drawn as SVG, where a page is to need no plotly: small, and the same without a script."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from html import escape

from cellwatt.report.blocks import Html
from cellwatt.report.drawing import plain
from cellwatt.report.figure import Axis, Figure, Json, Panel

WIDTH = 1070
"""Pixels of a figure."""
_GAP, _TITLE, _FOOT = 14, 20, 40
"""Between panels, above a panel with a title, below the last."""
_LINE = 15
"""Height of a line of the legend, pixels."""
_DASHES = {"dot": "2 3", "dash": "6 4"}


@dataclass(frozen=True)
class Drawn:
    """A figure with one column of panels of lines, stripes, upright lines and notes; the legend stands beside."""

    figure: Figure

    def html(self) -> Html:
        """Its markup; names of traces and notes are escaped already."""
        panels = [row[0] for row in self.figure.rows]
        left, right = self.figure.sides
        inner = WIDTH - left - right
        top, parts = 4.0, []
        for number, (panel, height) in enumerate(zip(panels, self.figure.heights, strict=True)):
            top += _TITLE * bool(panel.title)
            last = number == len(panels) - 1
            parts.append(_Frame(left, top, inner, height, panel).svg(last))
            top += height + _GAP
        size = f'viewBox="0 0 {WIDTH} {top + _FOOT:.0f}" width="100%"'
        style = "font-family:inherit;font-size:12px;fill:currentColor"
        head = f'<svg role=img aria-label="{escape(self.figure.label)}" {size} style="{style}">'
        return Html(f"<div class=wide>{head}{''.join(parts)}</svg></div>")


class _Frame:
    """One panel and its place, pixels."""

    def __init__(self, left: float, top: float, width: float, height: float, panel: Panel) -> None:
        self._left, self._top, self._width, self._height, self._panel = left, top, width, height, panel
        self._lines = [(trace, _points(trace)) for trace in panel.traces]
        xs = [x for _, points in self._lines for x, _ in points]
        ys = [y for _, points in self._lines for _, y in points if y is not None]
        self._x = panel.x.span or _padded(xs, 0.0)
        self._y = panel.y.span or _padded(ys, 0.06)

    def svg(self, last: bool) -> str:
        """Markup; the last panel names the axis."""
        clip = f"clip-{self._left:.0f}-{self._top:.0f}"
        box = f'x="{self._left:.0f}" y="{self._top:.0f}" width="{self._width:.0f}" height="{self._height:.0f}"'
        within = "".join([*map(self._mark, self._marks("text", False)), *self._curves()])
        return "".join(
            [
                f'<clipPath id="{clip}"><rect {box}/></clipPath>',
                *self._grid(self._panel.x if last else None),
                f'<g clip-path="url(#{clip})">{within}</g>',
                *(self._text(mark) for mark in self._marks("text", True)),
                *self._legend(),
                self._words(escape(self._panel.title), self._left, self._top - 6, weight="600")
                if self._panel.title
                else "",
            ]
        )

    def _marks(self, key: str, there: bool) -> list[Json]:
        return [mark for mark in self._panel.marks if (key in mark) == there]

    def _at(self, x: float) -> float:
        return self._left + self._width * (x - self._x[0]) / (self._x[1] - self._x[0])

    def _up(self, y: float) -> float:
        return self._top + self._height * (1 - (y - self._y[0]) / (self._y[1] - self._y[0]))

    def _share(self, y: float) -> float:
        return self._top + self._height * (1 - y)

    def _grid(self, named: Axis | None) -> Iterator[str]:
        line = 'stroke="currentColor" stroke-opacity="0.15"'
        right, bottom = self._left + self._width, self._top + self._height
        for value, text in _ticks(*self._y, 4):
            y = self._up(value)
            yield f'<line x1="{self._left:.0f}" x2="{right:.0f}" y1="{y:.1f}" y2="{y:.1f}" {line}/>'
            yield self._words(text, self._left - 6, y + 4, anchor="end")
        for value, text in _ticks(*self._x, 10):
            x = self._at(value)
            yield f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{self._top:.0f}" y2="{bottom:.0f}" {line}/>'
            if named is not None:
                yield self._words(text, x, bottom + 16, anchor="middle")
        if named is not None:
            yield self._words(escape(named.title), self._left + self._width / 2, bottom + 34, anchor="middle")

    def _curves(self) -> Iterator[str]:
        for trace, points in self._lines:
            style = trace["line"]
            path = _path([(self._at(x), None if y is None else self._up(y)) for x, y in points])
            yield (
                f'<path d="{path}" fill="none" stroke="{style["color"]}" stroke-width="{style["width"]}"'
                f"{_dashed(style)}/>"
            )

    def _mark(self, mark: Json) -> str:
        x = sorted((self._at(mark["x0"]), self._at(mark["x1"])))
        y = sorted((self._share(mark["y0"]), self._share(mark["y1"])))
        if mark["type"] == "line":
            style = mark["line"]
            return (
                f'<line x1="{x[0]:.1f}" x2="{x[1]:.1f}" y1="{y[0]:.1f}" y2="{y[1]:.1f}" stroke="{style["color"]}"'
                f' stroke-width="{style["width"]}"{_dashed(style)}/>'
            )
        return (
            f'<rect x="{x[0]:.1f}" y="{y[0]:.1f}" width="{x[1] - x[0]:.1f}" height="{y[1] - y[0]:.1f}"'
            f' fill="{mark["fillcolor"]}" opacity="{mark["opacity"]}"/>'
        )

    def _text(self, mark: Json) -> str:
        x = self._at(mark["x"])
        if not self._left <= x <= self._left + self._width:
            return ""
        colour = mark["font"].get("color", "currentColor")
        return self._words(mark["text"], x, self._share(mark["y"]), anchor="middle", colour=colour, size=10)

    def _legend(self) -> Iterator[str]:
        x = self._left + self._width + 10
        fits = max(int(self._height / _LINE), 1)
        for row, (trace, _) in enumerate(self._lines[:fits]):
            y = self._top + 10 + _LINE * row
            yield f'<rect x="{x:.0f}" y="{y - 6:.0f}" width="14" height="3" fill="{trace["line"]["color"]}"/>'
            yield self._words(trace["name"], x + 19, y, size=10)

    def _words(
        self,
        text: str,
        x: float,
        y: float,
        *,
        anchor: str = "start",
        weight: str = "400",
        colour: str = "",
        size: int = 12,
    ) -> str:
        fill = f' fill="{colour}"' if colour else ""
        style = f'text-anchor="{anchor}" font-weight="{weight}" font-size="{size}"{fill}'
        return f'<text x="{x:.1f}" y="{y:.1f}" {style}>{text}</text>'


def _points(trace: Json) -> list[tuple[float, float | None]]:
    """The places of a line; ``None`` is a gap."""
    y: Sequence[float | None] = trace["y"]
    if "x" in trace:
        return list(zip(trace["x"], y, strict=True))
    return [(trace["x0"] + trace["dx"] * i, value) for i, value in enumerate(y)]


def _path(points: Sequence[tuple[float, float | None]]) -> str:
    out, pen = [], "M"
    for x, y in points:
        if y is None:
            pen = "M"
            continue
        out.append(f"{pen}{x:.1f} {y:.1f}")
        pen = "L"
    return "".join(out)


def _dashed(style: Json) -> str:
    return f' stroke-dasharray="{_DASHES[style["dash"]]}"' if style.get("dash") in _DASHES else ""


def _padded(values: Sequence[float], share: float) -> tuple[float, float]:
    """Ends of an axis for these values."""
    low, high = min(values, default=0.0), max(values, default=1.0)
    room = (high - low) * share or max(abs(high), 1e-9) * 0.1 * (high == low)
    return low - room, high + room


def _ticks(low: float, high: float, about: int) -> Iterator[tuple[float, str]]:
    """Round places on an axis, and their texts."""
    rough = (high - low) / about
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(power * m for m in (1, 2, 5, 10) if power * m >= rough * 0.999)
    decimals = max(-math.floor(math.log10(step)), 0)
    for n in range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1):
        yield n * step, f"{plain([n * step], decimals)[0] + 0.0:.{decimals}f}".replace("-", "−")
