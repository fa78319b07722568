"""A live cell as lines of text: what ``watch``, ``demo`` and ``record`` show."""

from __future__ import annotations

import textwrap
import time
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime
from fnmatch import fnmatchcase
from typing import Final

import numpy as np
from rich.text import Text

from cellwatt.live.lines import Column, fit, plain, table
from cellwatt.live.power import power
from cellwatt.live.sparkline import bars, parts
from cellwatt.live.state import LiveCell

COLOUR: Final = {
    "ok": "green",
    "green": "green",
    "starting": "yellow",
    "amber": "yellow",
    "retrying": "red",
    "red": "red",
}
SEVERITY: Final = {"info": "cyan", "warning": "yellow", "error": "bold red"}
_FIGURES: Final = 35
"""Cells of a channel's figures, before its course."""
WAITING: Final = "waiting for the cell's first health message …"


@dataclass(frozen=True)
class Look:
    """Ways to look at a cell.

    ``width`` in cells; ``span`` s of a course; ``channels`` names or patterns of the channels to show, all where empty;
    ``power`` the measured power to hold against predictions.
    """

    width: int = 80
    span: float = 10.0
    ascii: bool = False
    channels: tuple[str, ...] = ()
    power: str | None = None

    def clock(self, ns: int) -> str:
        """UTC time of day, ``12:00:03``."""
        return datetime.fromtimestamp(ns * 1e-9, UTC).strftime("%H:%M:%S")

    def takes(self, channel: str) -> bool:
        """True if a channel is to be shown."""
        return not self.channels or any(fnmatchcase(channel, pattern) for pattern in self.channels)

    def page(self, lines: Iterator[Text] | list[Text]) -> Text:
        """The lines as one text."""
        return Text("\n", no_wrap=True).join(plain(line) if self.ascii else line for line in lines)


def whole(cell: LiveCell, look: Look, title: str = "", height: int = 0) -> Text:
    """Everything on one page: alarms, sources, motion, energy, power, then the channels that fit ``height``."""
    lines = head(cell, look, title)
    if not cell.status:
        return look.page(lines)
    lines += [*alarms(cell, look), *sources(cell, look), *motion(cell, look), *energy(cell)]
    lines += power(cell, look.span, look.width, look.power)
    room = height - len(lines) - 2
    if room > 1 and cell.frames.names:
        lines += [Text(), *channels(cell, look)[:room]]
    return look.page(lines)


def head(cell: LiveCell, look: Look, title: str = "") -> list[Text]:
    """State of the cell in a line, then what is to be known before all else."""
    s = cell.status
    if not s:
        return [Text(f"{title}{WAITING}", "dim"), *_silence(cell, look)]
    text = Text(f"{title}{s['site']}/{s['cell']} ", style="bold").append(
        f"● {cell.state}", style=COLOUR.get(cell.state, "")
    )
    recorder = f"recorder {s['recorder']['state']}" if s["recorder"] else "not recording"
    text.append(f"  {look.clock(s['time'])} UTC", style="not bold")
    text.append(f"  {recorder} · {s['frames']['count']} frames · {s['results']} results", style="not bold dim")
    warnings = [Text(f"warning: {warning}", "yellow") for warning in s.get("warnings", ())]
    return [fit(line, look.width) for line in (text, *warnings, *_silence(cell, look))]


def _silence(cell: LiveCell, look: Look) -> list[Text]:
    gone = cell.silent_for(time.monotonic())
    if gone is None:
        return []
    return [Text(f"no message for {gone:.0f} s; last at {look.clock(cell.heard_at)}", "bold red")]


def sources(cell: LiveCell, look: Look) -> list[Text]:
    """A line for each stream, then the errors of sources."""
    rows: list[tuple[str | Text, ...]] = []
    every = cell.status["sources"]
    for name, source in every.items():
        lost = sum(source["missed"].values()) + sum(source["dropped"].values())
        state = Text(source["state"], COLOUR.get(source["state"], ""))
        account = (str(source["expected"]), str(source["received"]), Text(str(lost), "red" if lost else "green"))
        for stream, figures in source["streams"].items() or [("", {"rate_hz": None, "jitter_p99_ms": None})]:
            clock = source["clocks"].get(stream)
            told = (
                "–" if figures["rate_hz"] is None else f"{figures['rate_hz']:.1f} Hz",
                "–" if figures["jitter_p99_ms"] is None else f"{figures['jitter_p99_ms']:.2f} ms",
                f"{clock['bound_ns'] * 1e-6:.2f} ms" if clock else "½ trip",
            )
            rows.append((name, state, stream, *told, *account))
            name, state, account = "", Text(), ("", "", Text())
    columns = (
        Column("source"),
        Column("state"),
        Column("stream", spare=3),
        *(Column(name, right=True, spare=n) for name, n in (("rate", 0), ("jitter p99", 1), ("clock ±", 0))),
        *(Column(name, right=True, spare=n) for name, n in (("expected", 2), ("received", 0), ("lost", 0))),
    )
    errors = [Text(f"{name}: {source['error']}", "red") for name, source in every.items() if source["error"]]
    return [*table(columns, rows, look.width), *(fit(error, look.width) for error in errors)]


def motion(cell: LiveCell, look: Look) -> list[Text]:
    """The last intervals, as many as fit, and the task."""
    text, task = Text("motion  ", style="bold"), Text()
    if cell.task:
        t = cell.task
        task = Text(f"  {t['name']} × {t['repetition']} ({t['variant']})", "bold")
    room = look.width - text.cell_len - task.cell_len
    shown: list[Text] = []
    for interval in reversed(cell.intervals):
        joints = "+".join(str(j) for j in interval["moving"]) or "rest"
        label = Text().append(f" {joints} ", "reverse" if interval["moving"] else "dim")
        label.append(f" {(interval['end'] - interval['start']) * 1e-9:.2f}s ", "dim")
        room -= label.cell_len
        if room < 0:
            break
        shown.insert(0, label)
    return [Text.assemble(text, *shown, task)]


def energy(cell: LiveCell) -> list[Text]:
    """Energy of the last task that ended, by consumer."""
    if not cell.energies:
        return []
    last = max((done[-1] for done in cell.energies.values()), key=lambda e: int(e["end"]))
    text = Text("energy  ", style="bold")
    text.append(f" {last['task']} × {last['repetition']}  {last['total']:.0f} J ", style="bold")
    text.append(f"± {last['uncertainty']:.1f} J  ", style="dim")
    unsure = last.get("group_uncertainty") or {}
    ranked = sorted(last["groups"].items(), key=lambda group: -abs(group[1]))
    for i, (name, value) in enumerate((name, value) for name, value in ranked if value):
        text.append(f"{' · ' * bool(i)}{name.replace('_', ' ')} {value:.1f}")
        if unsure.get(name) is not None:
            text.append(f" ± {unsure[name]:.2f}", style="dim")
    return [text]


def channels(cell: LiveCell, look: Look) -> list[Text]:
    """A line for each chosen channel: its latest value, its extremes and its course over the span."""
    history = cell.frames
    chosen = [(name, unit) for name, unit in zip(history.names, history.units, strict=True) if look.takes(name)]
    if not chosen:
        return [Text("no such channel" if history.names else "no frames yet: values come with them", "dim")]
    rows, end = history.within(look.span), int(history.time[-1])
    start = end - round(look.span * 1e9)
    longest = min(max(len(name) for name, _ in chosen), max(12, look.width - _FIGURES - 16))
    room = max(4, min(120, look.width - longest - _FIGURES))
    heading = f"{'channel':<{longest}} {'now':>8} {'':<6}{'least':>8} {'most':>8}  last {look.span:.0f} s"
    lines = [Text(heading, "bold")]
    for name, unit in chosen:
        values = history.of(name)[rows]
        known = values[np.isfinite(values)]
        line = fit(Text(name), longest)
        line.pad_right(longest - line.cell_len)
        if not len(known):
            lines.append(line.append(f" {'–':>8} {unit}", "dim"))
            continue
        low, high = float(known.min()), float(known.max())
        now = _number(float(values[-1])) if np.isfinite(values[-1]) else "–"
        line.append(f" {now:>8}", "bold").append(f" {unit:<6}").append(f"{_number(low):>8} {_number(high):>8}  ", "dim")
        lines.append(line.append(bars(parts(history.time[rows], values, start, end, room), low, high), "cyan"))
    return [fit(line, look.width) for line in lines]


def _number(value: float) -> str:
    """Four significant digits, without an exponent where that fits in eight cells."""
    size = abs(value)
    if size and not 1e-3 <= size < 1e6:
        return f"{value:.1e}"
    return f"{value:.{4 if size < 1 else 3 if size < 10 else 2 if size < 100 else 1 if size < 1000 else 0}f}"


def alarms(cell: LiveCell, look: Look) -> list[Text]:
    """The active alarms: the gravest first, of these the latest first."""
    if not (up := [standing.alarm for standing in cell.alarms.up]):
        return [Text("no alarm", "green")]
    order, lines = list(SEVERITY), list[Text]()
    for alarm in sorted(up, key=lambda a: (-order.index(a.severity), -a.since)):
        said = f"{alarm.severity} since {look.clock(alarm.since)}: {alarm.statement}"
        lines += [
            Text(line, SEVERITY[alarm.severity]) for line in textwrap.wrap(said, look.width, subsequent_indent="  ")
        ]
    return lines
