"""Charts of lines and points as SVG, drawn without a browser; figures are written as plotly writes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

COLOURS = ("#37474f", "#1e88e5", "#e53935", "#43a047", "#8e24aa")
LEFT, RIGHT, TOP, BOTTOM = 70, 20, 40, 50
SIZE = (760, 360)
TICKS = 6


@dataclass(frozen=True)
class Axis:
    """From values to pixels; ``ticks`` are the values that are written on it."""

    low: float
    high: float
    start: float
    end: float
    log: bool
    ticks: Sequence[float]

    @classmethod
    def of(cls, values: NDArray[np.float64], told: Mapping[str, Any], start: float, end: float) -> Axis:
        """An axis that holds all values, with the ticks that the figure wants."""
        log = told.get("type") == "log"
        seen = np.log10(values[values > 0]) if log else values
        margin = 0.03 * (float(np.ptp(seen)) or 1.0)
        low, high = float(seen.min()) - margin, float(seen.max()) + margin
        ticks = told.get("tickvals") or (_decades(low, high) if log else _steps(low, high))
        return cls(low, high, start, end, log, ticks)

    def __call__(self, value: float) -> float:
        """Its pixel."""
        place = np.log10(value) if self.log else value
        return float(self.start + (place - self.low) / (self.high - self.low) * (self.end - self.start))


def drawn(figure: Mapping[str, Any]) -> str:
    """The SVG of a figure: traces of lines or markers, axes with titles, linear or logarithmic, dotted lines in x."""
    layout, traces = figure["layout"], figure["data"]
    width, height = layout.get("width", SIZE[0]), layout.get("height", SIZE[1])
    x = Axis.of(_all(traces, "x"), layout.get("xaxis", {}), LEFT, width - RIGHT)
    y = Axis.of(_all(traces, "y"), layout.get("yaxis", {}), height - BOTTOM, TOP)
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        'font-family="Helvetica,Arial,sans-serif" font-size="12" fill="#37474f">'
    )
    parts = [head, f'<rect width="{width}" height="{height}" fill="#ffffff"/>', *_grid(x, y), *_titles(layout, x, y)]
    parts += [
        f'<line x1="{x(s["x0"]):.1f}" x2="{x(s["x0"]):.1f}" y1="{y.start}" y2="{y.end}" stroke="#90a4ae" '
        'stroke-dasharray="2 3"/>'
        for s in layout.get("shapes", ())
    ]
    place = float(LEFT)
    for number, trace in enumerate(traces):
        colour = COLOURS[number % len(COLOURS)]
        parts += [*_trace(trace, colour, x, y), _legend(trace["name"], colour, place)]
        place += 34 + 7.2 * len(trace["name"])
    return "\n".join([*parts, "</svg>\n"])


def _trace(trace: Mapping[str, Any], colour: str, x: Axis, y: Axis) -> list[str]:
    mode = trace.get("mode", "lines")
    points = [(x(a), y(b)) for a, b in zip(trace["x"], trace["y"], strict=True)]
    found = []
    if "lines" in mode:
        line = " ".join(f"{a:.1f},{b:.1f}" for a, b in points)
        found.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="1.5"/>')
    if "markers" in mode:
        radius = 3.5 if "lines" in mode else 1.8
        found += [f'<circle cx="{a:.1f}" cy="{b:.1f}" r="{radius}" fill="{colour}"/>' for a, b in points]
    return found


def _legend(name: str, colour: str, place: float) -> str:
    return (
        f'<rect x="{place:.0f}" y="13" width="14" height="4" fill="{colour}"/>'
        f'<text x="{place + 19:.0f}" y="19">{escape(name)}</text>'
    )


def _grid(x: Axis, y: Axis) -> list[str]:
    across = [
        f'<line x1="{x.start}" x2="{x.end}" y1="{y(t):.1f}" y2="{y(t):.1f}" stroke="#eceff1"/>'
        f'<text x="{x.start - 6}" y="{y(t) + 4:.1f}" text-anchor="end">{t:g}</text>'
        for t in y.ticks
    ]
    down = [
        f'<line x1="{x(t):.1f}" x2="{x(t):.1f}" y1="{y.start}" y2="{y.end}" stroke="#eceff1"/>'
        f'<text x="{x(t):.1f}" y="{y.start + 17}" text-anchor="middle">{t:g}</text>'
        for t in x.ticks
    ]
    frame = f'<path d="M{x.start} {y.end}V{y.start}H{x.end}" fill="none" stroke="#90a4ae"/>'
    return [*across, *down, frame]


def _titles(layout: Mapping[str, Any], x: Axis, y: Axis) -> list[str]:
    below, beside = ((layout.get(axis, {}).get("title") or {}).get("text", "") for axis in ("xaxis", "yaxis"))
    middle = (y.start + y.end) / 2
    return [
        f'<text x="{(x.start + x.end) / 2:.0f}" y="{y.start + 38}" text-anchor="middle">{escape(below)}</text>',
        f'<text x="18" y="{middle:.0f}" text-anchor="middle" transform="rotate(-90 18 {middle:.0f})">'
        f"{escape(beside)}</text>",
    ]


def _all(traces: Sequence[Mapping[str, Any]], axis: str) -> NDArray[np.float64]:
    return np.concatenate([np.asarray(trace[axis], np.float64) for trace in traces])


def _steps(low: float, high: float) -> list[float]:
    """Round values: steps of 1, 2 or 5 times a power of ten."""
    rough = (high - low) / TICKS
    decade = 10.0 ** np.floor(np.log10(rough))
    step = next(m * decade for m in (1, 2, 5, 10) if m * decade >= rough)
    first = np.ceil(low / step)
    return [round(float(n * step), 10) + 0.0 for n in np.arange(first, np.floor(high / step) + 1)]


def _decades(low: float, high: float) -> list[float]:
    """1, 2 and 5 times the powers of ten, of exponents."""
    found = [m * 10.0**n for n in range(int(np.floor(low)), int(np.ceil(high)) + 1) for m in (1, 2, 5)]
    return [float(f"{value:g}") for value in found if low <= np.log10(value) <= high]
