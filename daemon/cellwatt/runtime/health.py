"""The cell's health and schema as JSON-ready figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from cellwatt.channel import Stream
from cellwatt.frames import Layout
from cellwatt.runtime.troubles import Trouble


def describe(layout: Layout, streams: Mapping[str, tuple[Stream, ...]]) -> dict[str, Any]:
    """Streams and frame columns with units and methods, JSON-ready."""
    return {
        "streams": {
            source: [
                {"name": s.name, "rate_hz": s.rate, "clock": s.clock, "channels": [asdict(c) for c in s.channels]}
                for s in given
            ]
            for source, given in streams.items()
        },
        "frame": {"rate_hz": layout.rate, "channels": [asdict(c) for c in layout.channels]},
    }


def colour(status: Mapping[str, Any], troubles: Sequence[Trouble]) -> str:
    """``green``: no troubles; ``amber``: some; ``red``: no source delivers, or samples cannot be recorded."""
    sources = [s["state"] for s in status["sources"].values()]
    if (sources and all(s == "retrying" for s in sources)) or any(t.kind == "recorder" for t in troubles):
        return "red"
    return "amber" if troubles or any(s != "ok" for s in sources) else "green"
