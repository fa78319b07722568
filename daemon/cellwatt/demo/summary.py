"""Summary of a demo run, with its problems."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from cellwatt.demo import fault
from cellwatt.demo.cells import SOURCES
from cellwatt.demo.seen import Seen
from cellwatt.slots import HOST

RATE_TOLERANCE = 0.02
"""Largest allowed deviation of a measured rate, as a share of the nominal rate."""


def summary(seen: Seen, delays: Mapping[str, float], hooked: float | None, exit_code: int | None) -> dict[str, Any]:
    """Summarise a run: sources, and the spring attached at ``hooked``, UTC s. ``delays`` is as in ``sources_of``."""
    sources = sources_of(seen, delays)
    figures = None if hooked is None else fault.figures(seen, hooked)
    problems = problems_of(seen, sources, exit_code)
    if figures is not None:
        problems += fault.problems_of(figures, busy=any(source["host_stalled"] for source in sources.values()))
    if not seen.predictions:
        problems.append("the model predicted nothing")
    return {
        "ok": not problems,
        "problems": problems,
        "sources": sources,
        "frames": seen.samples["frame"],
        "intervals": len(seen.intervals),
        "tasks": seen.tasks,
        "fault": figures,
        "predictions": seen.predictions,
        "meter": _meter(seen),
        "alarms": [{k: a[k] for k in ("kind", "severity", "joint", "active", "statement")} for a in seen.alarms],
    }


def _meter(seen: Seen) -> dict[str, Any] | None:
    """Last ``meter_timing`` alarm, with its evidence."""
    timings = [a for a in seen.alarms if a["kind"] == "meter_timing"]
    return {"statement": timings[-1]["statement"], **timings[-1]["evidence"]} if timings else None


def sources_of(seen: Seen, delays: Mapping[str, float]) -> dict[str, dict[str, Any]]:
    """By source: counts, losses, polls missed because this PC was stalled, and streams.

    ``delays``: time, s, for which this PC did not let the source's emulator run; polls missed during it count as
    stalled, too. Each stream has its samples, rate, jitter and number of samples delivered.
    """
    sources = seen.status.get("sources", {})
    return {name: _source(name, status, seen, delays.get(name, 0.0)) for name, status in sources.items()}


def problems_of(seen: Seen, sources: Mapping[str, Mapping[str, Any]], exit_code: int | None) -> list[str]:
    """Problems of the sources, and of the delivery from daemon to subscriber."""
    problems = [p for name, source in sources.items() for p in _source_problems(name, source)]
    if exit_code != 0:
        problems.append(f"the daemon ended with exit code {exit_code}")
    if set(sources) != set(SOURCES):
        problems.append(f"sources seen: {', '.join(sources) or 'none'}")
    if seen.gaps:
        problems.append(f"{seen.gaps} gaps at the subscriber")
    return problems + delivery_problems(seen, sources)


def delivery_problems(seen: Seen, sources: Mapping[str, Mapping[str, Any]]) -> list[str]:
    """Differences between the subscriber's counts and the daemon's last health message."""
    problems = [
        f"{name}/{stream}: {s['samples']} samples, {s['delivered']} at the subscriber"
        for name, source in sources.items()
        for stream, s in source["streams"].items()
        if s["delivered"] + s["before_subscriber"] != s["samples"]
    ]
    made = seen.status.get("frames", {}).get("count")
    if made is None or made > seen.samples["frame"] + seen.first.get("frame", 0):  # it may have received later frames
        problems.append(f"{made} frames were made, the subscriber got {seen.samples['frame']}")
    return problems


def _source(name: str, status: Mapping[str, Any], seen: Seen, delay: float) -> dict[str, Any]:
    streams = {
        stream: {k: figures[k] for k in ("nominal_hz", "rate_hz", "jitter_p50_ms", "jitter_p99_ms")}
        | {"samples": figures["samples"], "delivered": seen.samples[f"raw/{name}/{stream}"]}
        | {"before_subscriber": seen.first.get(f"raw/{name}/{stream}", 0)}
        | {"clock_bound_ms": _bound(status, stream)}
        for stream, figures in status["streams"].items()
    }
    missed = sum(status["missed"].values())
    # As in ``Slots``: a missed poll is attributed to the PC if the emulator was stopped for half of its slot.
    while_delayed = math.ceil(2 * delay * sum(stream["nominal_hz"] or 0.0 for stream in streams.values()))
    stalled = min(status["missed"].get(HOST, 0) + while_delayed, missed)
    lost = missed + sum(status["dropped"].values()) - stalled
    counts = ("expected", "received", "missed", "dropped", "residue")
    own = {"lost": lost, "host_stalled": stalled, "kept_s": round(delay, 3), "streams": streams}
    return {k: status[k] for k in counts} | own


def _bound(status: Mapping[str, Any], stream: str) -> float | None:
    """Largest time bound, ms; None for a device without a clock, whose bound is half of each round trip."""
    clock = status.get("clocks", {}).get(stream)
    return round(clock["bound_ns"] * 1e-6, 3) if clock else None


def _source_problems(name: str, source: Mapping[str, Any]) -> list[str]:
    problems = []
    if source["lost"] or source["residue"]:
        problems.append(f"{name}: {source['lost']} samples lost, {source['residue']} not accounted for")
    for stream, s in source["streams"].items():
        if not s["nominal_hz"]:
            continue
        # For a polled source, ``host_stalled`` already includes the polls missed while the emulator was stopped.
        displaced = max(source["host_stalled"], source["kept_s"] * s["nominal_hz"])
        tolerance = RATE_TOLERANCE + displaced / max(s["samples"], 1)
        if s["rate_hz"] is None or abs(s["rate_hz"] / s["nominal_hz"] - 1) > tolerance:
            problems.append(f"{name}/{stream}: {s['rate_hz']} Hz instead of {s['nominal_hz']} Hz")
    return problems
