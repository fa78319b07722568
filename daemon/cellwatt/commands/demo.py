"""``cellwatt demo``: emulated devices, the daemon and a subscriber."""

from __future__ import annotations

import asyncio
import json
import shlex
import signal
import sys
import tempfile
import time
from collections.abc import Mapping
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import click

from cellwatt.commands import EXIT_FAILED, FOLDER, Commands
from cellwatt.commands.doctor import rates
from cellwatt.commands.options import SECONDS
from cellwatt.demo.demonstration import HEALTHY, Demonstration
from cellwatt.files import make_folder
from cellwatt.live.bulletin import Bulletin, message_of
from cellwatt.progress.terminal import show_table

PRINTED = ("health", "alarm", "task", "event", "gap")
"""Kinds of messages that are printed, one line each."""


class _Demos(Commands):
    """Further demos, from plugins."""

    points = "cellwatt.demos"
    headings: Mapping[str, tuple[str, ...]] = {}


@click.command(
    cls=_Demos, invoke_without_command=True, short_help="Run the daemon on emulated devices; needs no hardware."
)
@click.option("--seconds", type=SECONDS, default=60.0, show_default=True, help="Run time, s; at least 20.")
@click.option("--json", "as_json", is_flag=True, help="Print only the summary, as one JSON object.")
@click.option("--keep", type=FOLDER, help="Folder for recording and log.")
@click.pass_context
def command(context: click.Context, seconds: float, as_json: bool, keep: Path | None) -> None:
    """Run four emulated devices, the daemon and a subscriber; `demo explain` runs a demo of explain.

    After 20 s, or halfway if that is earlier, a spring is attached to an elbow joint. Exit code 0 only if no sample
    was lost and the alarm named the right joint in time.

    Prints the address of the page and one line per event.
    """
    if context.invoked_subcommand is not None:
        return
    if seconds < HEALTHY:
        raise click.BadParameter(f"at least {HEALTHY:.0f} s are needed to see healthy cycles before the fault")
    with nullcontext(keep) if keep else tempfile.TemporaryDirectory(prefix="cellwatt-demo-") as path:
        folder = Path(path).resolve()
        make_folder(folder)
        show = _quiet if as_json else _lines
        summary = asyncio.run(_run(show(folder, seconds)))
    if as_json:
        click.echo(json.dumps(summary))
    else:
        _show(summary)
        if keep:
            click.echo(f"recording and log are in {keep}; try: cellwatt plot {shlex.quote(str(keep))}")
    if not summary["ok"]:
        sys.exit(EXIT_FAILED)


def _quiet(folder: Path, seconds: float) -> Demonstration:
    return Demonstration(folder, seconds, lambda _: None, lambda step: click.echo(step, err=True))


def _lines(folder: Path, seconds: float) -> Demonstration:
    """Print a line for each step, task, alarm and change of a source, and the state of the cell every 10 s."""
    bulletin = Bulletin()

    def show(line: Mapping[str, Any]) -> None:
        news = [*bulletin.of(message_of(line))] if line["kind"] in PRINTED else []
        if bulletin.cell.status.get("sources"):
            news += bulletin.stands(time.monotonic())
        for text in news:
            say(text)

    def say(text: str) -> None:
        try:
            click.echo(text)
        except BrokenPipeError:
            run.stop("its output was closed")

    run = Demonstration(folder, seconds, show, say)
    return run


async def _run(demonstration: Demonstration) -> dict[str, Any]:
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, demonstration.stop, number.name)
    return await demonstration.run()


def _show(summary: Mapping[str, Any]) -> None:
    header = ("source", "stream", "nominal", "measured", "jitter p99", "samples", "at the subscriber", "lost")
    show_table(
        header,
        [
            (name, stream, *rates(s), str(s["samples"]), str(s["delivered"]), str(source["lost"]))
            for name, source in summary["sources"].items()
            for stream, s in source["streams"].items()
        ],
    )
    click.echo(f"{summary['frames']} frames, {summary['intervals']} intervals, {summary['tasks']} tasks")
    fault = summary["fault"]
    if fault and fault["statement"]:
        click.secho(f"alarm {fault['delay_s']} s after the spring: {fault['statement']}", bold=True)
    if summary["meter"]:
        click.echo(summary["meter"]["statement"])
    for name, source in summary["sources"].items():
        if source["host_stalled"]:
            missed = f"{name}: {source['host_stalled']} samples missed because this PC was stalled or busy otherwise"
            click.secho(missed, fg="yellow")
    for problem in summary["problems"]:
        click.secho(problem, fg="red")
    if summary["ok"]:
        click.secho("nothing was lost, and the alarm named the right joint in time", fg="green")
