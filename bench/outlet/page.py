"""The figures as Markdown for docs/performance.md: medians, with the least and the most in brackets."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

from outlet.figures import Figures, Spread

HEAD = ("outlet", "way", "a second", "lost, %", "process that serves, % of a core")
WAYS = {
    "cellwatt": "cellwatt",
    "plain_one_by_one": "aiomqtt, one by one",
    "plain_64_at_a_time": "aiomqtt, 64 at a time",
}
PACES = {"at_50_hz": "50 rows/s", "as_fast": "as fast as they are taken", "at_500_hz": "500 rows/s"}
NOTHING = "–"

Row = tuple[str, ...]


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


def markdown(found: Mapping[str, Figures]) -> str:
    """Both tables, of what was measured."""
    rows = [row for name, tell in ROWS.items() if name in found for row in _rows(name, found[name], tell)]
    parts = [table(HEAD, rows)] if rows else []
    if "blocked" in found:
        parts.append(blocked(found["blocked"]))
    return "\n\n".join(parts)


def _rows(name: str, figures: Figures, tell: Callable[[Figures], Iterator[Row]]) -> Iterator[Row]:
    if "not measured" in figures:
        yield (name, f"not measured: {figures['not measured']}", NOTHING, NOTHING, NOTHING)
    else:
        yield from tell(figures)


def _row(what: str, way: str, figures: Mapping[str, Spread], key: str) -> Row:
    lost = said(figures["lost"], 100) if "lost" in figures else NOTHING
    share = said(figures["core_percent"]) if "core_percent" in figures else NOTHING
    return (what, way, said(figures[key]), lost, share)


def _mqtt(found: Figures) -> Iterator[Row]:
    for qos in (1, 0):
        for way, text in WAYS.items():
            yield _row(f"MQTT, QoS {qos}, rows", text, found[f"{way}_qos_{qos}"], "rows_per_s")


def _metrics(found: Figures) -> Iterator[Row]:
    yield _row("metrics, answers", "cellwatt", found, "answers_per_s")
    yield _row("metrics, answers", "prometheus-client", found, "plain_answers_per_s")


def _historian(found: Figures) -> Iterator[Row]:
    if isinstance(found["influx"], str):
        yield ("InfluxDB", found["influx"], NOTHING, NOTHING, NOTHING)
    else:
        yield _row("InfluxDB, rows", "cellwatt", found["influx"], "rows_per_s")
        yield _row("InfluxDB, rows", "aiohttp, the same lines", found["plain_posts"], "rows_per_s")
        yield _row("InfluxDB, rows", "cellwatt, from a record", found["filled_in"], "rows_per_s")
    yield _row("lake, rows", "cellwatt, from a record", found["lake"], "rows_per_s")


def _opc_ua(found: Figures) -> Iterator[Row]:
    for pace, text in PACES.items():
        for way, library in {"cellwatt": "cellwatt", "plain": "asyncua"}.items():
            yield _row(f"OPC UA, values, {text}", library, found[f"{way}_{pace}"], "values_per_s")


ROWS: Mapping[str, Callable[[Figures], Iterator[Row]]] = {
    "mqtt": _mqtt,
    "metrics": _metrics,
    "historian": _historian,
    "opc_ua": _opc_ua,
}
TEXTS = {
    "lost": "samples dropped", "missed": "samples and polls missed", "unrecorded": "items not recorded",
    "frames_lost": "frames that a subscriber lost", "p50_ms": "age of a frame at a subscriber, p50, ms",
    "p99_ms": "the same, p99, ms", "pss_mb": "memory of all processes, MB", "tell_pss_mb": "memory of `tell`, MB",
    "mqtt_delivered": "rows that the broker took", "historian_delivered": "lines that InfluxDB took",
    "notify_delivered": "calls that the webhook took",
}  # fmt: skip
"""Figures of a daemon, in words; those that end in ``_percent`` are of its processes."""


def blocked(found: Figures) -> str:
    """A daemon without outlets, with servers that hang, and with servers that answer."""
    if "not measured" in found:
        return f"blocked: not measured: {found['not measured']}"
    ways = list(found)
    rows = [[_text(name), *(said(found[way][name]) for way in ways)] for name in found[ways[0]]]
    return table(["", *ways], rows)


def _text(name: str) -> str:
    if name.endswith("_percent"):
        return f"`{name.removesuffix('_percent')}`, % of a core"
    return TEXTS[name]
