"""The table of the outlets: the same values side by side, as each of them tells them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from typing import Final

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from cellwatt.demo.outlets.outlets import Outlets
from cellwatt.demo.outlets.said import ALARMS, CURRENT, POWER, SAMPLES, STATE, Compared, Said, Told, newest_of_all
from cellwatt.live.view import COLOUR

_UNITS: Final = {POWER: "W", CURRENT: "A"}
_NONE: Final = "–"


def whole(outlets: Outlets, title: str) -> RenderableType:
    """All on one page of 24 lines: the table, what is left out, the fault, and the ways to look by hand."""
    parts: list[RenderableType] = [Text(title, style="bold"), _table(outlets.said), *_remarks(outlets)]
    return Group(*parts)


def _table(said: Sequence[Said]) -> Table:
    table = Table(box=None, header_style="bold", padding=(0, 3, 0, 0))
    table.add_column("")
    for outlet in said:
        table.add_column(outlet.name, min_width=14, no_wrap=True)
    frames, states = _shown([outlet.frames for outlet in said]), _shown([outlet.states for outlet in said])
    table.add_row(Text(f"frame of {_clock(frames)}", style="dim"))
    for name in (POWER, CURRENT):
        table.add_row(f"  {name}", *(_cell(told, name) for told in frames))
    table.add_row(Text("health message", style="dim"))
    for name in (STATE, SAMPLES, ALARMS):
        table.add_row(f"  {name}", *(_cell(told, name) for told in states))
    table.add_row("  alarm of the fault", *(_alarm(outlet) for outlet in said))
    return table


def _shown(series: Sequence[Sequence[Told]]) -> list[Told | None]:
    """The newest that all tell; before there is any, the newest of each."""
    alike = newest_of_all(series)
    return [one[-1] if one else None for one in series] if alike is None else [*alike]


def _clock(frames: Sequence[Told | None]) -> str:
    at = next((told.time for told in frames if told is not None and told.time is not None), None)
    return _NONE if at is None else f"{datetime.fromtimestamp(at * 1e-9, UTC):%H:%M:%S.%f}"[:-4]


def _cell(told: Told | None, name: str) -> Text:
    if told is None:
        return Text(_NONE, style="dim")
    value = told.values.get(name)
    if value is None:
        return Text("not a metric", style="dim")
    if isinstance(value, str):
        return Text(value, style=COLOUR.get(value, ""))
    if name in _UNITS:
        return Text(f"{value:.4f} {_UNITS[name]}")
    return Text(f"{value:,.0f}".replace(",", " "))


def _alarm(said: Said) -> Text:
    if said.fault:
        return Text("up", style="bold red")
    return Text("not up") if said.complete else Text(_NONE, style="dim")


def _remarks(outlets: Outlets) -> Iterator[RenderableType]:
    if len(outlets.said) > 1:
        yield _compared(outlets.compared)
    for said in outlets.said:
        if said.problem:
            yield Text(f"{said.name} {said.problem}", style="yellow")
    for name, reason in outlets.left_out.items():
        yield Text(f"{name} is left out: {reason}", style="bold yellow")
    if any(said.fault for said in outlets.said):
        yield Text("\nthe alarm of the fault", style="bold")
        yield _lines({said.name: said.fault or "not there yet" for said in outlets.said})
    if outlets.open:
        yield Text("\nlook there yourself while the demo runs (--seconds 600 makes it longer)", style="bold")
        yield _lines(outlets.looks)


def _compared(compared: Compared) -> Text:
    if compared.unlike:
        told = (f"{n} times {name} was not the same in all" for name, n in compared.unlike.items())
        return Text("\n".join(told), style="bold red")
    if not compared.frames:
        return Text("nothing is compared yet", style="dim")
    alike = f"{compared.frames} frames and {compared.states} health messages compared: the same in all"
    return Text(alike, style="green")


def _lines(texts: Mapping[str, str]) -> Table:
    table = Table(box=None, show_header=False, padding=(0, 2, 0, 2))
    table.add_column(no_wrap=True, min_width=10)
    table.add_column(no_wrap=True)
    for name, text in texts.items():
        table.add_row(name, Text(text, overflow="ellipsis"))
    return table
