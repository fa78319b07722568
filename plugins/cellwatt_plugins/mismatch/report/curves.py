"""One channel of one recording over time: measured, simulation and model; below, what is left of the difference."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cellwatt.report import Axis, Figure, Panel
from cellwatt.report.drawing import band, curve, stretch
from cellwatt.report.numbers import capital, decimals_for, unit
from cellwatt.report.theme import FOUND, MEASURED, MODEL, NOISE, SIMULATION
from cellwatt_plugins.mismatch.report import wording
from cellwatt_plugins.mismatch.report.trace import Trace, telling_stretch
from cellwatt_plugins.mismatch.verdict.findings import Span

CURVES = 5
"""In each figure."""
OPENING = 20.0
"""Seconds shown at first, or more where the thinned curve would have fewer than ``OPENING_POINTS`` there."""
OPENING_POINTS = 900
MOST_MARKS = 80


def draw(trace: Trace, channel: str, floor: float, found: Sequence[Span], points: int, run: int) -> Figure:
    """``found``: stretches where findings on this channel sit; ``points``: most per curve; ``run``: its number."""
    digits = _digits(trace, channel, floor)
    upper, lower = (
        [
            curve(name, y, colour, start=start, step=trace.step, width=width, most=points, decimals=digits)
            for name, y, colour, width in some
        ]
        for start in [float(trace.time[0])]
        for some in (
            [
                ("measured", trace.column(trace.measured, channel), MEASURED, 2.4),
                ("simulation", trace.column(trace.simulation, channel), SIMULATION, 1.3),
                ("model", trace.column(trace.model, channel), MODEL, 1.3),
            ],
            [
                ("measured − simulation", trace.residual(channel, trace.simulation), SIMULATION, 1.1),
                ("measured − model", trace.residual(channel, trace.model), MODEL, 1.1),
            ],
        )
    )
    x, y = Axis("s", _opening(trace, channel, points)), Axis(unit(trace.units[trace.channels.index(channel)]))
    marks = band(-2 * floor, 2 * floor, NOISE)
    mine = [s for s in found if s.recording == trace.name][:MOST_MARKS]
    edges = [stretch(s.start, s.end, FOUND, 1.0, (0.97, 1.0)) for s in mine]
    rows = [[Panel(upper, x, y)], [Panel(lower, x, y, [*marks, *edges])]]
    label = f"{capital(wording.channel_name(channel))} in {trace.name} over time, and what is left of the difference"
    return Figure(label, rows, (190, 118), "x", layout={"hovermode": "x unified"}, when=("run", run))


def _opening(trace: Trace, channel: str, points: int) -> tuple[float, float]:
    density = min(points / max(len(trace.time), 1), 1.0) / max(trace.step, 1e-9)
    start, end = telling_stretch(trace, channel, max(OPENING, OPENING_POINTS / density))
    return round(start, 3), round(end, 3)


def _digits(trace: Trace, channel: str, floor: float) -> int:
    """Decimals kept: a fiftieth of the noise, which the eye cannot tell from the whole."""
    if np.isfinite(floor) and floor > 0:
        return max(decimals_for(floor / 50, 1), 0)
    values = trace.column(trace.measured, channel)
    known = values[np.isfinite(values)]
    return max(decimals_for(float(np.ptp(known)) / 5000 if len(known) else 1.0, 1), 0)
