"""The figures as Markdown for docs/capacity.md: the median of the runs, with the least and the most in brackets."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from capacity.figures import Figures, Spread


def said(spread: Spread, factor: float = 1.0) -> str:
    """A figure with its spread."""
    median, least, most = (_number(spread[key] * factor) for key in ("median", "least", "most"))
    return median if least == most else f"{median} ({least} … {most})"


def _number(value: float) -> str:
    if value and abs(value) < 1:
        return f"{value:.2g}"
    return f"{value:.1f}" if abs(value) < 10 else f"{value:,.0f}"


def table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table."""
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def router(found: Figures) -> str:
    """Costs of a router, the cells that it carries, and what was measured with some."""
    ways = list(found)
    costs = {
        "message_in_us": "a message in, µs", "message_out_us": "a message out, µs",
        "mb_in_ms": "a MB in, ms", "mb_out_ms": "a MB out, ms",
    }  # fmt: skip
    rows = [[text, *(said(found[way]["costs"][name]) for way in ways)] for name, text in costs.items()]
    rows += [["the same, fitted to all runs", *(_fitted(found[way]["fitted"]) for way in ways)]]
    memory = {"kB_a_cell": "memory a linked cell, kB", "MB_empty": "memory without any, MB"}
    rows += [[text, *(said(found[way]["memory"][name]) for way in ways)] for name, text in memory.items()]
    rows += [
        [f"cells a core, half of it free: {want}", *(f"{found[way]['most_cells'][want]:,}" for way in ways)]
        for want in found[ways[0]]["most_cells"]
    ]
    scenes = [
        [
            way, str(scene["cells"]), scene["want"], said(scene["core"], 100), said(scene["said"], 100),
            said(scene["ms_a_1000"]), said(scene["delivered"], 100),
        ]
        for way in ways for scene in found[way]["cells"]
    ]  # fmt: skip
    head = ["link", "cells", "read", "measured, % of a core", "the constants say", "ms a 1,000 forwarded", "arrived, %"]
    return "\n\n".join([table(["", *ways], rows), table(head, scenes)])


def _fitted(costs: Mapping[str, float]) -> str:
    return ", ".join(_number(cost) for cost in costs.values())


def subscribers(found: Figures) -> str:
    """What each number of readers takes and how late frames come."""
    rows = [
        [
            way, str(row["readers"]), said(row["tell"], 100), said(row["router"], 100), said(row["reader"], 100),
            said(row["messages"]), said(row["late_ms"]), said(row["lost"]),
        ]
        for way, figures in found.items() for row in figures["rows"]
    ]  # fmt: skip
    head = ["way, read", "readers", "`tell`, %", "router, %", "readers, %", "messages/s each", "p99 late, ms", "lost"]
    added = [
        [way, said(figures["tell_a_reader"], 100), said(figures["router_a_reader"], 100)]
        for way, figures in found.items()
    ]
    more = table(["one more reader", "of `tell`, % of a core", "of the router, % of a core"], added)
    return "\n\n".join([table(head, rows), more])


def record(found: Figures) -> str:
    """MB a day by what takes them, and messages a second by topic."""
    names = {
        "record": "record (MCAP)", "levels": "levels of the page", "zenoh": "Zenoh, one reader of all (TCP)",
        "payload": "of that content", "mqtt": "MQTT, 1 row/s (TCP)", "influx": "InfluxDB, 1 row/s (bodies)",
        "channels": "channels of the frames",
    }  # fmt: skip
    cells = list(found)
    rows = [
        [text, *(said(found[cell][name]) for cell in cells)] for name, text in names.items() if name in found[cells[0]]
    ]
    topics = [
        [cell, topic, f"{each['messages']:g}", f"{each['bytes']:,}"]
        for cell in cells for topic, each in sorted(found[cell]["topics"].items())
    ]  # fmt: skip
    return "\n\n".join(
        [table(["MB a day", *cells], rows), table(["cell", "topic", "messages/s", "bytes each"], topics)]
    )


PAGES: Mapping[str, Callable[[Figures], str]] = {
    "router": router,
    "subscribers": subscribers,
    "record": record,
}
