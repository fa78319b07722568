"""``cellwatt demo``: the whole chain on emulated devices."""

from __future__ import annotations

import asyncio
import json
import signal
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import click
from rich.console import Console
from rich.table import Table

from cellwatt.commands import EXIT_FAILED, Commands
from cellwatt.demo.demonstration import Demonstration
from cellwatt.errors import CellwattError, why
from cellwatt.live.bulletin import Bulletin

HEALTHY = 20.0
"""s at least, to see healthy cycles before the fault."""
TOLD = ("health", "alarm", "task", "event", "gap")
"""Kinds of messages that have a line."""


class _Demos(Commands):
    """Other demos, of plugins."""

    points = "cellwatt.demos"
    headings: Mapping[str, tuple[str, ...]] = {}


@click.command(
    cls=_Demos, invoke_without_command=True, short_help="Try the whole chain on emulated devices: no hardware."
)
@click.option("--seconds", default=60.0, show_default=True, help="How long; at least 20.")
@click.option("--json", "as_json", is_flag=True, help="Print only the summary, as one JSON object.")
@click.option("--keep", type=click.Path(file_okay=False, path_type=Path), help="Keep recording and log in this folder.")
@click.pass_context
def command(context: click.Context, seconds: float, as_json: bool, keep: Path | None) -> None:
    """Run emulated devices, the daemon and a subscriber; `demo explain` shows what explain finds.

    There are four devices; after 20 s, or halfway, a spring is hooked on an elbow. Exit code 0 only if nothing was
    lost and the alarm named the right joint in time.

    It prints the address of the page, and a line for all that happens.
    """
    if context.invoked_subcommand is not None:
        return
    if seconds < HEALTHY:
        raise click.BadParameter(f"at least {HEALTHY:.0f} s are needed to see healthy cycles before the fault")
    with nullcontext(keep) if keep else tempfile.TemporaryDirectory(prefix="cellwatt-demo-") as place:
        folder = Path(place).resolve()
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise CellwattError(f"{folder} cannot be made: {why(error)}") from error
        show = _quiet if as_json else _lines
        summary = asyncio.run(_run(show(folder, seconds)))
    if as_json:
        click.echo(json.dumps(summary))
    else:
        _show(summary)
        if keep:
            click.echo(f"recording and log are in {keep}; try: cellwatt plot {keep}")
    if not summary["ok"]:
        sys.exit(EXIT_FAILED)


def _quiet(folder: Path, seconds: float) -> Demonstration:
    return Demonstration(folder, seconds, lambda _: None, lambda step: click.echo(step, err=True))


def _lines(folder: Path, seconds: float) -> Demonstration:
    """Print a line for each step, task, alarm and change of a source, and every 10 s how the cell stands."""
    bulletin = Bulletin()

    def show(line: Mapping[str, Any]) -> None:
        news = [*bulletin.of_line(line)] if line["kind"] in TOLD else []
        if bulletin.cell.status.get("sources"):
            news += bulletin.stands(time.monotonic())
        for text in news:
            say(text)

    def say(text: str) -> None:
        try:
            click.echo(text)
        except BrokenPipeError:
            run.stop("nobody reads its output any more")

    run = Demonstration(folder, seconds, show, say)
    return run


async def _run(demonstration: Demonstration) -> dict[str, Any]:
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, demonstration.stop, number.name)
    return await demonstration.run()


def _show(summary: Mapping[str, Any]) -> None:
    console = Console()
    console.print(_sources(summary["sources"]))
    console.print(f"{summary['frames']} frames, {summary['intervals']} intervals, {summary['tasks']} tasks")
    fault = summary["fault"]
    if fault and fault["statement"]:
        console.print(f"alarm {fault['delay_s']} s after the spring: {fault['statement']}", style="bold")
    if summary["meter"]:
        console.print(summary["meter"]["statement"])
    for name, source in summary["sources"].items():
        if source["host_stalled"]:
            told = f"{name}: {source['host_stalled']} samples fell due while this PC stood still or was taken by others"
            console.print(told, style="bold yellow")
    for problem in summary["problems"]:
        console.print(problem, style="bold red")
    if summary["ok"]:
        console.print("nothing was lost, and the alarm named the right joint in time", style="bold green")


def _sources(sources: Mapping[str, Any]) -> Table:
    table = Table(title="summary", box=None, header_style="bold", title_justify="left")
    for name in ("source", "stream", "nominal", "measured", "jitter p99", "samples", "at the subscriber", "lost"):
        table.add_column(name, justify="left" if name in {"source", "stream"} else "right")
    for name, source in sources.items():
        for stream, s in source["streams"].items():
            nominal = f"{s['nominal_hz']:g} Hz" if s["nominal_hz"] else "on change"
            measured = "–" if s["rate_hz"] is None else f"{s['rate_hz']:.2f} Hz"
            jitter = "–" if s["jitter_p99_ms"] is None else f"{s['jitter_p99_ms']:.2f} ms"
            cells = (nominal, measured, jitter, str(s["samples"]), str(s["delivered"]), str(source["lost"]))
            table.add_row(name, stream, *cells)
    return table
