"""The parts of the page that plotly draws, each packed where it stands and drawn by the browser when first seen."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Sequence
from functools import cache
from html import escape
from typing import Any

import numpy as np
from plotly.offline import get_plotlyjs

from cellwatt_plugins.mismatch.report import clouds, curves, heat, words
from cellwatt_plugins.mismatch.report.cards import section
from cellwatt_plugins.mismatch.report.trace import Trace, worst_first
from cellwatt_plugins.mismatch.verdict.findings import Findings, Span, Where

MOST_RUNS = 6
"""Recordings drawn over time; of more, those whose simulation is furthest off."""
ALL_POINTS, FEWEST_POINTS, MOST_POINTS = 800_000, 300, 8000
"""Points of all time curves together, and limits for one curve."""
MOST_CLOUDS = 6
STATES = (("simulation", "Simulation"), ("refit", "Simulation, retuned"), ("model", "Model"))


@cache
def engine() -> str:
    """Plotly itself, for the browser."""
    return f"<script type=text/plain id=plotly>{_pack(get_plotlyjs())}</script>"


def sections(findings: Findings, traces: Sequence[Trace], floors: dict[str, float]) -> str:
    """Where the mismatch sits, channels over time, and what the difference follows; ``floors`` by channel."""
    first = _prominent(findings, floors)
    drawn = [_strips(traces, floors), _over_time(findings, traces, floors, first)]
    if findings.verdict != "no_mismatch":
        drawn.append(_followed(findings, traces, floors, first[:MOST_CLOUDS]))
    return "".join(drawn)


def _strips(traces: Sequence[Trace], floors: dict[str, float]) -> str:
    top = heat.colour_range(traces, floors)
    strips = "".join(
        _figure(heat.draw(traces, key, floors, top), f"data-state={key}", hidden=key != "simulation")
        for key, _ in STATES
    )
    lead = "Rms of the residual ÷ noise floor. Grey is noise; blank cells were not visited."
    return section("Where the mismatch sits", lead, _switch("state", STATES) + strips)


def _over_time(findings: Findings, traces: Sequence[Trace], floors: dict[str, float], first: Sequence[str]) -> str:
    shown = worst_first(traces, floors, MOST_RUNS)
    share = ALL_POINTS // (len(shown) * len(floors) * curves.CURVES)
    points = int(np.clip(share, FEWEST_POINTS, MOST_POINTS))
    parts = []
    for channel in [*first, *(c for c in floors if c not in first)]:
        spans = _spans(findings, channel)
        drawn = "".join(
            _figure(curves.draw(t, channel, floors[channel], spans, points), f"data-run={i}", hidden=i > 0)
            for i, t in enumerate(shown)
            if channel in t.channels
        )
        name = escape(words.capital(words.channel_name(channel)))
        parts.append(f"<details{' open' * (channel in first)}><summary>{name}</summary>{drawn}</details>")
    chooser = _switch("run", [(str(i), t.name) for i, t in enumerate(shown)]) if len(shown) > 1 else ""
    lead = _time_lead(traces, shown, any(f.where.times for f in findings.findings))
    return section("Measured, simulation and model over time", lead, chooser + "".join(parts))


def _time_lead(traces: Sequence[Trace], shown: Sequence[Trace], marked: bool) -> str:
    parts = ["Opens where the simulation is furthest off; drag to zoom, double-click for the whole recording."]
    parts += ["Grey band: ± 2 noise floors."]
    parts += ["Yellow edge: a finding sits here."] if marked else []
    held = any(t.held_out is not None and t.held_out.any() and not t.held_out.all() for t in shown)
    parts += ["Blue shade: held out of the fit."] if held else []
    parts += [f"These are the {len(shown)} that differ most of {len(traces)}."] if len(shown) < len(traces) else []
    return " ".join(parts)


def _followed(findings: Findings, traces: Sequence[Trace], floors: dict[str, float], first: Sequence[str]) -> str:
    pictures = [
        f"<h3>{escape(words.capital(words.channel_name(c)))}</h3>"
        + _figure(clouds.draw(traces, c, floors[c], _where(findings, c)), "", hidden=False)
        for c in first
    ]
    lead = (
        "Residuals against what drives them; the curve is the median of what the model adds to the simulation. "
        "Grey band: ± 2 noise floors. Yellow: where a finding sits."
    )
    return section("What the difference follows", lead, "".join(pictures))


def _prominent(findings: Findings, floors: dict[str, float]) -> list[str]:
    """Channels to show first: what is missing, what is unexplained, what is mistuned; with none of them the first."""
    missing, mistuned = (
        [f.improvement.channel for f in findings.findings if f.kind == kind] for kind in ("missing", "mistuned")
    )
    named = [*missing, *(r.channel for r in findings.unexplained), *mistuned]
    return [c for c in dict.fromkeys(named) if c in floors] or list(floors)[:1]


def _spans(findings: Findings, channel: str) -> list[Span]:
    return [s for f in findings.findings if channel in f.where.channels for s in f.where.times]


def _where(findings: Findings, channel: str) -> Where | None:
    places = [f.where for f in findings.findings if f.improvement.channel == channel]
    rests = [Where((r.channel,), r.position, r.velocity) for r in findings.unexplained if r.channel == channel]
    return next(iter([*places, *rests]), None)


def _pack(text: str) -> str:
    """Gzip in base64, which page.js unpacks: a third of the size."""
    return base64.b64encode(gzip.compress(text.encode(), 6, mtime=0)).decode()


def _figure(figure: dict[str, Any], attributes: str, *, hidden: bool) -> str:
    place = f'<div class=figure {attributes}{" hidden" * hidden} style="height:{figure["layout"]["height"]}px">'
    text = json.dumps(figure, allow_nan=False, separators=(",", ":"))
    return f"{place}<script type=text/plain>{_pack(text)}</script></div>"


def _switch(name: str, choices: Sequence[tuple[str, str]]) -> str:
    """One of several: page.js shows what has ``data-name`` equal to the chosen value."""
    buttons = "".join(
        f'<label><input type=radio name={name} value="{escape(key)}"{" checked" * (i == 0)}>'
        f"<span>{escape(label)}</span></label>"
        for i, (key, label) in enumerate(choices)
    )
    return f"<div class=switch>{buttons}</div>"
