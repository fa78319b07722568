"""One channel of one recording over time: measured, simulation and model; below them, the residuals."""

from __future__ import annotations

from collections.abc import Sequence

from cellwatt.arrays import Float
from cellwatt.report import Axis, Figure, Panel
from cellwatt.report.drawing import band, curve, stretch
from cellwatt.report.figure import Json
from cellwatt.report.numbers import capital, decimals_for, unit
from cellwatt.report.theme import FOUND, MEASURED, MODEL, NOISE, SIMULATION
from cellwatt_plugins.explain.report import wording
from cellwatt_plugins.explain.report.trace import Trace, telling_stretch
from cellwatt_plugins.explain.verdict.findings import Span

CURVES = 5
"""Curves per figure."""
OPENING = 20.0
"""Seconds shown at first; more if the thinned curve has fewer than ``OPENING_POINTS`` in that time."""
OPENING_POINTS = 900
MOST_MARKS = 80


def draw(trace: Trace, channel: str, floor: float, found: Sequence[Span], points: int, run: int) -> Figure:
    """Draw a channel; ``found``: stretches of its findings; ``points``: most per curve; ``run``: number of the
    recording."""
    # The eye cannot distinguish a fiftieth of the noise from the exact value.
    digits, start = max(decimals_for(floor / 50, 1), 0), float(trace.time[0])

    def drawn(name: str, values: Float, colour: str, width: float) -> Json:
        return curve(name, values, colour, start=start, step=trace.step, width=width, most=points, decimals=digits)

    upper = [
        drawn("measured", trace.column(trace.measured, channel), MEASURED, 2.4),
        drawn("simulation", trace.column(trace.simulation, channel), SIMULATION, 1.3),
        drawn("model", trace.column(trace.model, channel), MODEL, 1.3),
    ]
    lower = [
        drawn("measured − simulation", trace.residual(channel, trace.simulation), SIMULATION, 1.1),
        drawn("measured − model", trace.residual(channel, trace.model), MODEL, 1.1),
    ]
    x, y = Axis("s", _opening(trace, channel, points)), Axis(unit(trace.units[trace.channels.index(channel)]))
    mine = [s for s in found if s.recording == trace.name][:MOST_MARKS]
    marks = [*band(-2 * floor, 2 * floor, NOISE), *(stretch(s.start, s.end, FOUND, 1.0, (0.97, 1.0)) for s in mine)]
    label = f"{capital(wording.channel_name(channel))} in {trace.name} over time, and the residuals"
    return stacked(label, Panel(upper, x, y), Panel(lower, x, y, marks), ("run", run))


def stacked(label: str, upper: Panel, lower: Panel, when: tuple[str, int]) -> Figure:
    """Curves over time, and their residuals below them; shown when the switch ``when`` has its value."""
    return Figure(label, [[upper], [lower]], (190, 118), "x", layout={"hovermode": "x unified"}, when=when)


def _opening(trace: Trace, channel: str, points: int) -> tuple[float, float]:
    density = min(points / len(trace.time), 1.0) / trace.step
    start, end = telling_stretch(trace, channel, max(OPENING, OPENING_POINTS / density))
    return round(start, 3), round(end, 3)
