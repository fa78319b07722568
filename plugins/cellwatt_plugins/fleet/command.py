"""``cellwatt fleet``.

Pinocchio and scipy are imported when it runs, so that a missing one is told with the extra that has it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from cellwatt.commands.inputs import INPUT
from cellwatt.commands.numbers import FiniteRange
from cellwatt.commands.quiet import with_progress
from cellwatt.commands.scheduling import with_scheduler
from cellwatt.progress import stage


@click.command(short_help="Find cells that drift and joints that wear.")
@click.argument("lake", type=INPUT)
@click.option(
    "--robot",
    "robots",
    multiple=True,
    metavar="[CELLS=]FILE",
    help="Description of the robots of these cells (weld-*=mh12.yaml), or of all. Else the nearest robot.yaml above.",
)
@click.option("--weeks", type=click.IntRange(min=6), help="Only so many last weeks.")
@click.option(
    "--chance",
    type=FiniteRange(min=1e-6, max=0.5),
    default=0.01,
    show_default=True,
    help="Chance of one false finding in the whole fleet.",
)
@click.option(
    "--least",
    type=FiniteRange(min=0.0, max=1.0),
    default=0.05,
    show_default=True,
    help="Smallest change that is told, as a share.",
)
@click.option("--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder to write.")
@click.option("--json", "as_json", is_flag=True, help="Print fleet.json.")
@click.option("--no-report", is_flag=True, help="Leave out report.html.")
@with_scheduler
@with_progress
def fleet(lake: Path, out: Path, as_json: bool, no_report: bool, **asked: Any) -> None:
    """Say which cells of a LAKE of recordings drift and which joints wear.

    LAKE holds a folder for each cell, with .mcap, .parquet or .csv, or is the lake of the historian. Writes fleet.json,
    fleet.csv (one table) and report.html (one page).
    """
    from cellwatt_plugins.fleet.api import fleet as compare
    from cellwatt_plugins.fleet.report import report_of
    from cellwatt_plugins.fleet.written import in_words, write

    found = compare(lake, **asked)
    write(found, out)
    if not no_report:
        with stage("writing the report"):
            report_of(found, lake.resolve().name).write(out / "report.html")
    click.echo(json.dumps(found.as_json()) if as_json else in_words(found, out))
