"""The state of each cell of a site, as figures and as text."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from cellwatt.alarms import SEVERITIES


def summary(name: str, status: Mapping[str, Any]) -> dict[str, Any]:
    """Figures of a cell from its health, ready for JSON; ``state`` is ``None`` if ``status`` is empty: no answer."""
    sources = status.get("sources", {}).values()
    return {
        "cell": name,
        "state": status.get("state"),
        "time": status.get("time"),
        "sources": len(sources),
        "sources_ok": sum(source["state"] == "ok" for source in sources),
        "received": sum(source["received"] for source in sources),
        "lost": sum(sum(s["missed"].values()) + sum(s["dropped"].values()) for s in sources),
        "alarms": [{k: a[k] for k in ("id", "severity", "since", "statement")} for a in status.get("alarms", ())],
    }


def stands(cell: Mapping[str, Any]) -> str:
    """State and counts of a cell's ``summary``, as text."""
    return (
        f"{cell['cell']} is {cell['state']}: {cell['sources_ok']} of {cell['sources']} sources ok, "
        f"{cell['received']} samples received, {cell['lost']} lost"
    )


def alarm_count(count: int) -> str:
    """A number of active alarms, as text."""
    return f"{count} alarm{'s' * (count != 1)}" if count else "no alarm"


def line(cell: Mapping[str, Any]) -> str:
    """A cell's ``summary`` as a line, with its most severe active alarm."""
    if cell["state"] is None:
        return f"{cell['cell']}: heard, does not answer"
    grave = max(cell["alarms"], key=lambda alarm: SEVERITIES.index(alarm["severity"]), default=None)
    worst = "" if grave is None else f", {grave['severity']}: {grave['statement']}"
    return f"{stands(cell)}, {alarm_count(len(cell['alarms']))}{worst}"
