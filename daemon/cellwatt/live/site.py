"""All cells of a site as a table."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.text import Text

from cellwatt.live.lines import Column, table
from cellwatt.live.view import COLOUR, SEVERITY, Look
from cellwatt.subscriber import Health

_COLUMNS = (
    Column("cell"),
    Column("state"),
    Column("at"),
    Column("sources", right=True),
    Column("received", right=True, spare=2),
    Column("lost", right=True),
    Column("alarms", right=True),
    Column("the gravest", spare=1),
)


def site(cells: Mapping[str, Health | None], look: Look) -> list[Text]:
    """A line for each cell: its state, sources that are ok, samples, and the gravest of its active alarms."""
    if not cells:
        return [Text("no cell is heard", "red")]
    return table(_COLUMNS, [_row(name, health, look) for name, health in cells.items()], look.width)


def summary(name: str, health: Health | None) -> dict[str, Any]:
    """A cell in figures, JSON-ready; ``state`` is ``None`` if it does not answer us."""
    status = health.status if health is not None else {}
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


def _row(name: str, health: Health | None, look: Look) -> tuple[str | Text, ...]:
    told = summary(name, health)
    if told["state"] is None:
        return (name, Text("heard, does not answer", "yellow"), *[""] * 6)
    order = list(SEVERITY)
    alarms = sorted(told["alarms"], key=lambda a: -order.index(a["severity"]))
    return (
        name,
        Text(f"● {told['state']}", COLOUR.get(told["state"], "")),
        "" if told["time"] is None else look.clock(told["time"]),
        f"{told['sources_ok']}/{told['sources']}",
        str(told["received"]),
        Text(str(told["lost"]), "red" if told["lost"] else "green"),
        Text(str(len(alarms)), SEVERITY[alarms[0]["severity"]] if alarms else "green"),
        Text(alarms[0]["statement"], SEVERITY[alarms[0]["severity"]]) if alarms else "",
    )
