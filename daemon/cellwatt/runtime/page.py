"""A recording as one HTML page that needs nothing else."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
import plotly.graph_objects as go
from numpy.typing import NDArray
from plotly.subplots import make_subplots

from cellwatt.errors import ConfigError, RecordingError
from cellwatt.frames import Frames
from cellwatt.record import Recording
from cellwatt.registry import stage as find_stage
from cellwatt.results import Alarm, Interval, Task
from cellwatt.stage import CellInfo

MOST_POINTS = 8000
"""Points drawn per curve; longer ones are thinned by keeping the extremes of each span."""
SHADES = ("#4c78a8", "#f58518", "#54a24b", "#e45756", "#72b7b2", "#b279a2", "#ff9da6", "#9d755d")


def draw(recording: Recording, start: float | None, end: float | None, wanted: Sequence[str]) -> str:
    """The page as text. Raises ``RecordingError`` where there is nothing to draw.

    ``start`` and ``end`` s from the recording's start; ``wanted``: parts of channel names, all where empty.
    """
    frames = recording.frames_table()
    origin = int(frames.time[0])
    seconds = np.asarray((frames.time - origin) * 1e-9, np.float64)
    shown = (seconds >= (start if start is not None else -np.inf)) & (seconds <= (end if end is not None else np.inf))
    groups = _groups(frames, wanted)
    if not groups or not shown.any():
        raise RecordingError("nothing to draw: no such channels, or no frames in that span")
    results = list(recording.results())
    intervals = [r for r in results if isinstance(r, Interval) and r.closed] or _segment(frames)
    height = max(0.06, 1 / len(groups) - 0.02)
    figure = make_subplots(
        len(groups),
        1,
        shared_xaxes=True,
        vertical_spacing=min(0.03, 0.3 / len(groups)),
        row_heights=[height] * len(groups),
        subplot_titles=[title for title, _ in groups],
    )
    for row, (_, columns) in enumerate(groups, start=1):
        _curves(figure, row, frames, columns, seconds, shown)
    span = (float(seconds[shown][0]), float(seconds[shown][-1]))
    bands, labels = _bands(intervals, origin, span)
    lines = _lines([r for r in results if isinstance(r, Alarm)], origin, span)
    figure.update_layout(
        shapes=bands + lines,
        annotations=[*figure.layout.annotations, *labels],
        template="plotly_white",
        height=110 + 210 * len(groups),
        margin={"l": 70, "r": 30, "t": 40, "b": 50},
        hovermode="x unified",
    )
    for row in range(1, len(groups) + 1):
        top = figure.layout["yaxis" if row == 1 else f"yaxis{row}"].domain[1]
        figure.update_layout({_legend(row): {"y": top, "yanchor": "top", "font": {"size": 10}}})
    figure.update_xaxes(title_text="s since the start", row=len(groups), col=1)
    figure.update_xaxes(range=span)
    tasks = [r for r in results if isinstance(r, Task)]
    body = figure.to_html(full_html=False, include_plotlyjs="inline", config={"displaylogo": False})
    return _page(recording, frames, tasks, results, body)


def _groups(frames: Frames, wanted: Sequence[str]) -> list[tuple[str, list[int]]]:
    """Curves that belong into one diagram: same source, same last part of the name, same unit."""
    groups: dict[str, list[int]] = {}
    for i, channel in enumerate(frames.layout.channels):
        if wanted and not any(w in channel.name for w in wanted):
            continue
        if channel.kind == "discrete" and not wanted:
            continue
        quantity = channel.short.rsplit(".", 1)[-1]
        groups.setdefault(f"{channel.source} · {quantity} [{channel.unit}]", []).append(i)
    return list(groups.items())


def _curves(
    figure: Any, row: int, frames: Frames, columns: list[int], seconds: NDArray[np.float64], shown: NDArray[np.bool_]
) -> None:
    holes = np.append(np.diff(seconds) > 1.5 / frames.layout.rate, False)
    for n, column in enumerate(columns):
        x, y = thin(seconds[shown], np.where(holes, np.nan, frames.values[:, column])[shown], MOST_POINTS)
        name = frames.layout.channels[column].short
        line = {"color": SHADES[n % len(SHADES)], "width": 1.3}
        trace = go.Scatter(x=x, y=y, name=name, mode="lines", line=line, legend=_legend(row), connectgaps=False)
        figure.add_trace(trace, row=row, col=1)


def _legend(row: int) -> str:
    """Each diagram has a legend of its own beside it."""
    return "legend" if row == 1 else f"legend{row}"


def thin(x: NDArray[np.float64], y: NDArray[np.float64], most: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """At most about ``most`` of the points (n,), keeping the lowest and highest of each span so that peaks stay."""
    if len(x) <= most:
        return x, y
    span = 2 * len(x) // most + 1
    whole = len(x) // span * span
    blocks = np.where(np.isfinite(y[:whole]), y[:whole], 0.0).reshape(-1, span)
    base = np.arange(len(blocks)) * span
    picks = np.unique(np.concatenate([base + blocks.argmin(1), base + blocks.argmax(1), np.arange(whole, len(x))]))
    return x[picks], y[picks]


def _segment(frames: Frames) -> list[Interval]:
    """Intervals found now, where there are joints to find them in."""
    found = find_stage("segment")
    try:
        stage = found("segment", found.Settings(), frames.layout, CellInfo("", "", None, Path()))
    except ConfigError:
        return []
    results = [*stage.process(frames, ()), *stage.close()]
    return [r for r in results if isinstance(r, Interval) and r.closed]


def _bands(intervals: Sequence[Interval], origin: int, span: tuple[float, float]) -> tuple[list[Any], list[Any]]:
    """Shapes and labels of the intervals in which something moves, for all diagrams at once."""
    sets = sorted({i.moving for i in intervals if i.moving})
    shapes, labels = [], []
    for interval in intervals:
        left, right = (interval.start - origin) * 1e-9, (interval.end - origin) * 1e-9
        if not interval.moving or right < span[0] or left > span[1]:
            continue
        colour = SHADES[sets.index(interval.moving) % len(SHADES)]
        place = {"xref": "x", "yref": "paper", "x0": left, "x1": right, "y0": 0, "y1": 1}
        style = {"fillcolor": colour, "opacity": 0.13, "line": {"width": 0}, "layer": "below"}
        shapes.append({"type": "rect", **place, **style})
        text = "+".join(str(j) for j in interval.moving)
        font = {"size": 10, "color": colour}
        anchor = {"xref": "x", "yref": "paper", "x": (left + right) / 2, "y": 1.0, "yanchor": "bottom"}
        labels.append({**anchor, "text": text, "showarrow": False, "font": font, "yshift": 16})
    return shapes, labels


def _lines(alarms: Sequence[Alarm], origin: int, span: tuple[float, float]) -> list[Any]:
    """Upright lines where alarms were raised (red) and cleared (green)."""
    shapes = []
    for alarm in alarms:
        at = (alarm.time - origin) * 1e-9
        if span[0] <= at <= span[1] and alarm.severity != "info":
            style = {"color": "#c62828" if alarm.active else "#2e7d32", "width": 1.5, "dash": "dot"}
            shapes.append(
                {"type": "line", "xref": "x", "yref": "paper", "x0": at, "x1": at, "y0": 0, "y1": 1, "line": style}
            )
    return shapes


def _page(recording: Recording, frames: Frames, tasks: Sequence[Task], results: Sequence[Any], body: str) -> str:
    header = recording.header
    start = datetime.fromtimestamp(recording.start * 1e-9, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
    length = (recording.end - recording.start) * 1e-9
    lines = [
        f"<b>{escape(header.site)}/{escape(header.cell)}</b> · {start} · {length:.1f} s · {len(frames)} frames at "
        f"{frames.layout.rate:g} Hz",
        "Coloured bands: intervals, labelled with the joints that move. "
        "Dotted lines: alarms raised (red) and cleared (green).",
    ]
    names = sorted({t.name for t in tasks})
    for name in names:
        mine = [t for t in tasks if t.name == name]
        variants = ", ".join(sorted({t.variant for t in mine}))
        lines.append(f"{escape(name)}: {len(mine)} repetitions ({escape(variants)})")
    raised = [r for r in results if isinstance(r, Alarm) and r.active]
    rows = "".join(
        f"<tr><td>{(a.time - int(frames.time[0])) * 1e-9:.2f} s</td><td>{a.severity}</td>"
        f"<td>{escape(a.statement)}</td></tr>"
        for a in raised
    )
    table = f"<table><tr><th>at</th><th></th><th>alarm</th></tr>{rows}</table>" if raised else "<p>No alarms.</p>"
    damage = "".join(f"<p class=bad>{escape(str(d))}</p>" for d in recording.damage)
    head = "".join(f"<p>{line}</p>" for line in lines)
    style = (
        "body{font:14px/1.45 system-ui,sans-serif;margin:24px auto;max-width:1180px;color:#222}"
        "td,th{text-align:left;padding:2px 14px 2px 0}p{margin:4px 0}.bad{color:#c62828}"
    )
    return (
        f"<!doctype html><html lang=en><meta charset=utf-8><title>{escape(header.cell)}</title>"
        f"<style>{style}</style><h1>{escape(header.cell)}</h1>{head}{damage}{table}{body}</html>"
    )
