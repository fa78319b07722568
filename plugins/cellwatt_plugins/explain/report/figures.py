"""Sections with figures: channels over time, and the quantities on which the difference depends."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from cellwatt.report import Block, Folded, Section, Switch, heading
from cellwatt.report.numbers import capital
from cellwatt_plugins.explain.report import clouds, curves, wording
from cellwatt_plugins.explain.report.trace import Trace, worst_first
from cellwatt_plugins.explain.verdict.findings import Findings, Span, Where

MOST_RUNS = 6
"""Largest number of recordings drawn over time; of more, those with the largest error of the simulation."""
ALL_POINTS, FEWEST_POINTS, MOST_POINTS = 800_000, 300, 8000
"""Points of all time curves together, and limits for one curve."""
MOST_CLOUDS = 6
FOLLOWED = (
    "Residuals against the quantities on which they depend; the curve is the median of what the model adds. "
    "Grey band: ± 2 noise floors. Yellow: range of a finding."
)


def sections(findings: Findings, traces: Sequence[Trace], floors: Mapping[str, float]) -> list[Section]:
    """All sections; ``floors`` are noise floors by channel."""
    first = _prominent(findings, floors)
    drawn = [_over_time(findings, traces, floors, first)]
    if findings.verdict != "no_mismatch":
        blocks: list[Block] = []
        for c in first[:MOST_CLOUDS]:
            cloud = clouds.draw(traces, c, floors[c], _where(findings, c))
            blocks += [heading(capital(wording.channel_name(c))), cloud]
        drawn.append(Section("What the difference follows", blocks, FOLLOWED))
    return drawn


def _over_time(
    findings: Findings, traces: Sequence[Trace], floors: Mapping[str, float], first: Sequence[str]
) -> Section:
    shown = worst_first(traces, floors, MOST_RUNS)
    share = ALL_POINTS // (len(shown) * len(floors) * curves.CURVES)
    points = int(np.clip(share, FEWEST_POINTS, MOST_POINTS))
    parts = []
    for channel in [*first, *(c for c in floors if c not in first)]:
        spans = _spans(findings, channel)
        runs = [(i, t) for i, t in enumerate(shown) if channel in t.channels]
        drawn = [curves.draw(t, channel, floors[channel], spans, points, i) for i, t in runs]
        parts.append(Folded(capital(wording.channel_name(channel)), drawn, channel in first))
    lead = _time_lead(traces, shown, any(f.where.times for f in findings.findings))
    return Section("Measured, simulation and model over time", [Switch("run", [t.name for t in shown]), *parts], lead)


def _time_lead(traces: Sequence[Trace], shown: Sequence[Trace], marked: bool) -> str:
    parts = ["Opens where the error of the simulation is largest; drag to zoom, double-click for the whole recording."]
    parts += ["Grey band: ± 2 noise floors."]
    parts += ["Yellow edge: times of a finding."] if marked else []
    parts += [f"Shown: the {len(shown)} of {len(traces)} that differ most."] if len(shown) < len(traces) else []
    return " ".join(parts)


def _prominent(findings: Findings, floors: Mapping[str, float]) -> list[str]:
    """Channels to show first: with missing effects, unexplained, mistuned; if there are none, the first channel."""
    missing, mistuned = (
        [f.improvement.channel for f in findings.findings if (f.kind == "mistuned") == off] for off in (False, True)
    )
    named = [*missing, *(r.channel for r in findings.unexplained), *mistuned]
    return [c for c in dict.fromkeys(named) if c in floors] or list(floors)[:1]


def _spans(findings: Findings, channel: str) -> list[Span]:
    return [s for f in findings.findings if channel in f.where.channels for s in f.where.times]


def _where(findings: Findings, channel: str) -> Where | None:
    places = [f.where for f in findings.findings if f.improvement.channel == channel]
    rests = [Where((r.channel,), r.position, r.velocity) for r in findings.unexplained if r.channel == channel]
    return next(iter([*places, *rests]), None)
