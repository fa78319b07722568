"""Plots as inline SVG: stacked bars and lines over time."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]

WIDTH = 1040
LABEL = 140
ROW = 22
PLOT_HEIGHT = 240
MOST_POINTS = 400
"""Points of a line: more cannot be seen."""


@dataclass(frozen=True)
class Bar:
    """One row of stacked parts."""

    label: str
    parts: Mapping[str, float]
    """Class of the part → its size."""
    note: str
    """Written at its end."""


@dataclass(frozen=True)
class Line:
    """One curve, or dots."""

    kind: str
    """Class, which gives its colour."""
    time: Float
    """s."""
    value: Float
    dots: bool = False


def stacked(bars: Sequence[Bar], unit: str, title: str) -> str:
    """Stacked bars on one scale."""
    largest = max(sum(max(v, 0.0) for v in bar.parts.values()) for bar in bars)
    scale = (WIDTH - LABEL - 130) / largest
    rows = []
    for i, bar in enumerate(bars):
        y, x = 8 + i * ROW, float(LABEL)
        rows.append(f'<text class=label x="{LABEL - 8}" y="{y + 13}">{escape(bar.label)}</text>')
        for kind, value in bar.parts.items():
            width = max(value, 0.0) * scale
            tip = f"<title>{escape(bar.label)}, {kind.replace('-', ' ')}: {value:.2f} {unit}</title>"
            rows.append(f'<rect class="{kind}" x="{x:.1f}" y="{y}" width="{width:.1f}" height="{ROW - 5}">{tip}</rect>')
            x += width
        rows.append(f'<text class=note x="{x + 6:.1f}" y="{y + 13}">{escape(bar.note)}</text>')
    return _figure("".join(rows), 16 + len(bars) * ROW, title)


def over_time(lines: Sequence[Line], title: str) -> str:
    """Power over the time of one repetition, W over s."""
    low = min(0.0, *(float(line.value.min()) for line in lines))
    high = max(float(line.value.max()) for line in lines)
    end = max(float(line.time[-1]) for line in lines)
    left, right, top = 66, WIDTH - 12, 10

    def place(line: Line) -> tuple[Float, Float]:
        thin = np.unique(np.linspace(0, len(line.time) - 1, min(MOST_POINTS, len(line.time))).astype(int))
        x = left + line.time[thin] / end * (right - left)
        y = top + (high - line.value[thin]) / (high - low) * PLOT_HEIGHT
        return x, y

    parts = [_grid(low, high, end, (left, right, top))]
    for line in lines:
        xs, ys = place(line)
        if line.dots:
            parts += [
                f'<circle class="{line.kind}" cx="{x:.1f}" cy="{y:.1f}" r="2"/>' for x, y in zip(xs, ys, strict=True)
            ]
        else:
            points = " ".join(f"{x:.1f},{y:.1f}" for x, y in zip(xs, ys, strict=True))
            parts.append(f'<polyline class="{line.kind}" points="{points}"/>')
    return _figure("".join(parts), PLOT_HEIGHT + 40, title)


def _grid(low: float, high: float, end: float, frame: tuple[int, int, int]) -> str:
    left, right, top = frame
    out = []
    for value in _ticks(low, high):
        y = top + (high - value) / (high - low) * PLOT_HEIGHT
        out.append(f'<line class=grid x1="{left}" x2="{right}" y1="{y:.1f}" y2="{y:.1f}"/>')
        out.append(f'<text class=label x="{left - 6}" y="{y + 4:.1f}">{value:g} W</text>')
    for value in _ticks(0.0, end):
        x = left + value / end * (right - left)
        out.append(f'<text class=tick x="{x:.1f}" y="{top + PLOT_HEIGHT + 18}">{value:g} s</text>')
    return "".join(out)


def _ticks(low: float, high: float) -> list[float]:
    """Round numbers between two values, about five of them."""
    rough = (high - low) / 5
    power = 10 ** math.floor(math.log10(rough))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= rough)
    return [k * step for k in range(math.ceil(low / step), math.floor(high / step) + 1)]


def _figure(body: str, height: float, title: str) -> str:
    return f'<svg viewBox="0 0 {WIDTH} {height:.0f}" role=img aria-label="{escape(title)}">{body}</svg>'
