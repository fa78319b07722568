"""``cellwatt demo``: emulated devices, the daemon and a subscriber."""

from __future__ import annotations

import asyncio
import json
import shlex
import signal
import sys
import tempfile
import time
from collections.abc import Awaitable, Callable, Mapping
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

RUNS: Mapping[str, Callable[[Demonstration], Awaitable[dict[str, Any]]]] = {
    "small": Demonstration.small,
    "all": Demonstration.every_driver,
}
STARTING = "starting emulated devices, the daemon and a subscriber"
PRINTED = ("health", "alarm", "task", "event", "gap")
"""Kinds of messages that are printed, one line each."""


class _Demos(Commands):
    """Further demos, from plugins."""

    points = "cellwatt.demos"
    headings: Mapping[str, tuple[str, ...]] = {}


@click.command(
    cls=_Demos, invoke_without_command=True, short_help="Run the daemon on emulated devices; needs no hardware."
)
@click.option("--cell", type=click.Choice(list(RUNS)), default="small", show_default=True, help="Cell to emulate.")
@click.option(
    "--seconds", type=SECONDS, default=60.0, show_default=True, help="Run time, s; at least 20, with --cell all 1."
)
@click.option("--json", "as_json", is_flag=True, help="Print only the summary, as one JSON object.")
@click.option("--keep", type=FOLDER, help="Folder for recording and log.")
@click.pass_context
def command(context: click.Context, cell: str, seconds: float, as_json: bool, keep: Path | None) -> None:
    """Run emulated devices, the daemon and a subscriber; `demo explain` runs a demo of explain.

    The small cell has four devices. After 20 s, or halfway if that is earlier, a spring is attached to an elbow joint.
    Exit code 0 only if no sample was lost and the alarm named the right joint in time. The cell "all" has one device
    of every driver, each at its usual rate; exit code 0 only if no sample was lost.

    Prints the address of the page and one line per event.
    """
    if context.invoked_subcommand is not None:
        return
    if cell == "small" and seconds < HEALTHY:
        raise click.BadParameter(f"at least {HEALTHY:.0f} s are needed to see healthy cycles before the fault")
    if seconds < 1:
        raise click.BadParameter("at least 1 s is needed to see rates")
    with nullcontext(keep) if keep else tempfile.TemporaryDirectory(prefix="cellwatt-demo-") as path:
        folder = Path(path).resolve()
        make_folder(folder)
        show = _quiet if as_json else _lines
        run = show(folder, seconds)
        if cell != "small":  # that one begins with the address of its page
            run.say(STARTING)
        summary = asyncio.run(_run(cell, run))
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


async def _run(cell: str, demonstration: Demonstration) -> dict[str, Any]:
    for number in (signal.SIGTERM, signal.SIGINT):
        asyncio.get_running_loop().add_signal_handler(number, demonstration.stop, number.name)
    return await RUNS[cell](demonstration)


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
    if "fault" in summary:
        click.echo(f"{summary['frames']} frames, {summary['intervals']} intervals, {summary['tasks']} tasks")
        fault = summary["fault"]
        if fault and fault["statement"]:
            click.secho(f"alarm {fault['delay_s']} s after the spring: {fault['statement']}", bold=True)
        if summary["meter"]:
            click.echo(summary["meter"]["statement"])
    for name, reason in summary.get("left_out", {}).items():
        click.secho(f"{name} is skipped: {reason}", fg="yellow")
    for name, source in summary["sources"].items():
        if source["host_stalled"]:
            missed = f"{name}: {source['host_stalled']} samples missed because this PC was stalled or busy otherwise"
            click.secho(missed, fg="yellow")
    for problem in summary["problems"]:
        click.secho(problem, fg="red")
    if summary["ok"]:
        named = ", and the alarm named the right joint in time" if "fault" in summary else ""
        click.secho(f"nothing was lost{named}", fg="green")
