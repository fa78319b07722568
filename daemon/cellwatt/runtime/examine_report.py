"""The page of ``doctor``: of each device what is declared beside what came, and how its time stamps lie."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.batch import Batch
from cellwatt.report import (
    Axis,
    Block,
    Columns,
    Figure,
    Folded,
    Notes,
    Panel,
    Provenance,
    Report,
    Section,
    Table,
    heading,
)
from cellwatt.report.drawing import line, upright
from cellwatt.report.numbers import fixed, listed, number, unit
from cellwatt.report.page import Tone
from cellwatt.report.theme import GOOD, MODEL
from cellwatt.runtime.examine import ChannelCheck, Examination
from cellwatt.units import Units

Float = NDArray[np.float64]

TONES: Final[dict[str, Tone]] = {"ok": "good", "warning": "part", "failed": "open"}
BINS: Final = 80
WIDEST: Final = 3.0
"""Intervals beyond this many medians are counted, and not drawn."""
LEAD: Final = (
    "Left: time between two samples; dotted: as declared. Right: how far a time stamp may be off, over the reading."
)


def report(
    name: str,
    found: Sequence[Examination],
    read: Mapping[str, Sequence[Batch]],
    units: Units,
    provenance: Provenance,
) -> Report:
    """The page of a cell's examination; ``read`` holds what came of each source."""
    worst = max((e.verdict for e in found), key=list(TONES).index)
    return Report(
        name=name,
        subject="devices",
        facts=[f"{len(found)} device{'s' * (len(found) != 1)}", f"read for {_seconds(read):.0f} s"],
        verdict=_verdict(found),
        tone=TONES[worst],
        sections=[
            *(
                Section(f"{e.name}: {_device(e)}", _source(e, read[e.name], units), LEAD if i == 0 else "")
                for i, e in enumerate(found)
            ),
            Section("Declared and measured", [_streams(found)]),
        ],
        provenance=provenance,
    )


def _seconds(read: Mapping[str, Sequence[Batch]]) -> float:
    """Length of the longest reading, s."""
    return max((float(b[-1].time[-1] - b[0].time[0]) * 1e-9 for b in read.values() if b), default=0.0)


def _verdict(found: Sequence[Examination]) -> str:
    of = {verdict: [e.name for e in found if e.verdict == verdict] for verdict in TONES}
    parts = []
    if of["failed"]:
        parts.append(f"{listed(of['failed'])} failed")
    if of["warning"]:
        parts.append(
            f"{listed(of['warning'])} {'differs' if len(of['warning']) == 1 else 'differ'} from what is declared"
        )
    if of["ok"]:
        parts.append(f"{listed(of['ok'])} {'works' if len(of['ok']) == 1 else 'work'} as declared")
    return "; ".join(parts) + "."


def _device(e: Examination) -> str:
    identity = e.status.get("identity") or {}
    return " ".join(filter(None, (identity.get(key, "") for key in ("maker", "model", "firmware")))) or e.driver


def _source(e: Examination, batches: Sequence[Batch], units: Units) -> list[Block]:
    """Pictures of each stream, findings, and the channels."""
    names = dict.fromkeys(batch.stream.name for batch in batches)
    out: list[Block] = []
    for stream in names:
        mine = [batch for batch in batches if batch.stream.name == stream]
        out += [heading(stream)] * (len(names) > 1)
        out.append(_times(e.name, mine))
    out.append(Notes([f"{e.verdict}: {text}" if e.verdict != "ok" else text for text in e.findings]))
    channels = [_channel(check, units) for check in e.channels]
    heads = ("channel", "lowest", "highest", "unit", "with a number")
    return [
        *out,
        *([Folded(f"{len(channels)} channels", [Table(f"Channels of {e.name}", heads, channels)])] if channels else []),
    ]


def _times(name: str, batches: Sequence[Batch]) -> Columns:
    """Histogram of the intervals of a stream, and the bound of its time stamps."""
    stream = batches[0].stream
    time = np.concatenate([batch.time for batch in batches])
    bound = np.concatenate([batch.bound for batch in batches]) * 1e-6
    counts, edges, beyond = _histogram(np.diff(time) * 1e-6)
    step = {"shape": "hv", "color": MODEL, "width": 1.5}
    drawn = [{**line("samples", edges, [*counts, 0], MODEL), "line": step, "fill": "tozeroy"}]
    told = f"intervals, {beyond} longer than drawn" if beyond else "intervals"
    marks = [upright(1e3 / stream.rate, GOOD)] if stream.rate else []
    left = Panel(drawn, Axis("ms"), Axis("samples"), marks, told)
    since = (time - time[0]) * 1e-9
    y = Axis("± ms", log=bool((bound > 0).all()))
    right = Panel([line("bound", *_peaks(since, bound), MODEL)], Axis("s"), y, title="bound of the time stamps")
    of = f"{name}.{stream.name}"
    return Columns(
        [Figure(f"Intervals between samples of {of}", [[left]], (170,), legend=False)],
        [Figure(f"Bound of the time stamps of {of}", [[right]], (170,), legend=False)],
    )


def _histogram(intervals: Float) -> tuple[NDArray[np.int64], Float, int]:
    """Counts (BINS,) of intervals (N,), ms, edges (BINS + 1,), and how many lie beyond the last."""
    if not len(intervals):
        return np.zeros(BINS, np.int64), np.linspace(0.0, 1.0, BINS + 1), 0
    top = min(float(intervals.max()) * 1.05, WIDEST * float(np.median(intervals)))
    counts, edges = np.histogram(intervals, BINS, (0.0, top))
    return counts, edges, int((intervals > top).sum())


def _peaks(time: Float, values: Float, most: int = 1000) -> tuple[Float, Float]:
    """The largest of each of at most ``most`` spans of (N,) ``values``, and the time at which it begins."""
    starts = np.unique(np.linspace(0, len(values), min(most, len(values)), endpoint=False).astype(int))
    return time[starts], np.maximum.reduceat(values, starts)


def _streams(found: Sequence[Examination]) -> Table:
    heads = ("source", "stream", "declared", "measured", "jitter p99, ms", "time stamps ±, ms", "lost", "verdict")
    return Table("Declared and measured", heads, [row for e in found for row in _rows(e)])


def _rows(e: Examination) -> list[list[str]]:
    lost = sum(sum(e.status.get(part, {}).values()) for part in ("missed", "dropped"))
    streams: Mapping[str, Any] = e.status.get("streams", {})
    if not streams:
        return [[e.name, *["–"] * 6, e.verdict]]
    return [
        [
            e.name,
            name,
            f"{figures['nominal_hz']:g} Hz" if figures["nominal_hz"] else "on change",
            "–" if figures["rate_hz"] is None else f"{figures['rate_hz']:.1f} Hz",
            fixed(figures["jitter_p99_ms"], 2),
            fixed(e.status["bounds_ms"][name], 3),
            str(lost),
            e.verdict,
        ]
        for name, figures in streams.items()
    ]


def _channel(check: ChannelCheck, units: Units) -> list[str]:
    shown = units.of(check.unit)
    ends = ["–" if end is None else number(float(shown.of(end)), 4) for end in (check.low, check.high)]
    return [check.name, *ends, unit(shown.name), f"{100 * check.finite:.4g} %"]
