"""``cellwatt demo``: the whole chain on emulated devices."""

from __future__ import annotations

import asyncio
import json
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.live import Live
from rich.table import Table

from cellwatt.commands import EXIT_FAILED
from cellwatt.commands.live_view import LiveCell
from cellwatt.runtime.demonstration import Demonstration


@click.command()
@click.option("--seconds", default=30.0, show_default=True, help="How long; at least 20.")
@click.option("--json", "as_json", is_flag=True, help="Print only the summary, as one JSON object.")
@click.option("--keep", type=click.Path(file_okay=False, path_type=Path), help="Keep recording and log in this folder.")
def command(seconds: float, as_json: bool, keep: Path | None) -> None:
    """Run four emulated devices, the daemon and a subscriber; hook a spring on an elbow halfway.

    Exit code 0 only if nothing was lost and the alarm named the right joint in time.
    """
    if seconds < 20:
        raise click.BadParameter("at least 20 s are needed to see healthy cycles before the fault")
    with tempfile.TemporaryDirectory(prefix="cellwatt-demo-") as temporary:
        folder = keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        summary = _quiet(folder, seconds) if as_json else _live(folder, seconds)
    if as_json:
        click.echo(json.dumps(summary))
    else:
        _show(summary)
        if keep:
            click.echo(f"recording and log are in {keep}; try: cellwatt plot {keep}")
    if not summary["ok"]:
        sys.exit(EXIT_FAILED)


def _quiet(folder: Path, seconds: float) -> dict[str, Any]:
    return asyncio.run(Demonstration(folder, seconds, lambda _: None, lambda _: None).run())


def _live(folder: Path, seconds: float) -> dict[str, Any]:
    view, title = LiveCell(), ["starting four emulated devices, the daemon and a subscriber"]
    with Live(refresh_per_second=8, transient=False) as live:

        def show(line: Mapping[str, Any]) -> None:
            view.add(line["kind"], line["content"])
            live.update(view.render(f"[{title[0]}]  "))

        def say(text: str) -> None:
            title[0] = text

        return asyncio.run(Demonstration(folder, seconds, show, say).run())


def _show(summary: Mapping[str, Any]) -> None:
    console = Console()
    table = Table(title="summary", box=None, header_style="bold", title_justify="left")
    for name in ("source", "stream", "nominal", "measured", "jitter p99", "samples", "at the subscriber", "lost"):
        table.add_column(name, justify="left" if name in {"source", "stream"} else "right")
    for name, source in summary["sources"].items():
        for stream, s in source["streams"].items():
            nominal = f"{s['nominal_hz']:g} Hz" if s["nominal_hz"] else "on change"
            measured = "–" if s["rate_hz"] is None else f"{s['rate_hz']:.2f} Hz"
            jitter = "–" if s["jitter_p99_ms"] is None else f"{s['jitter_p99_ms']:.2f} ms"
            cells = (nominal, measured, jitter, str(s["samples"]), str(s["delivered"]), str(source["lost"]))
            table.add_row(name, stream, *cells)
    console.print(table)
    console.print(f"{summary['frames']} frames, {summary['intervals']} intervals, {summary['tasks']} tasks")
    fault = summary["fault"]
    if fault["statement"]:
        console.print(f"alarm {fault['delay_s']} s after the spring: {fault['statement']}", style="bold")
    for problem in summary["problems"]:
        console.print(problem, style="bold red")
    if summary["ok"]:
        console.print("nothing was lost, and the alarm named the right joint in time", style="bold green")
