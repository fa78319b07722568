"""``cellwatt fleet``.

Pinocchio and scipy are imported when the command runs; if one is missing, the error names the extra to install.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cellwatt.commands.options import INPUT, FiniteRange, with_columns, with_progress, with_scheduler
from cellwatt.files import write_file
from cellwatt.progress import stage

if TYPE_CHECKING:
    from cellwatt_plugins.fleet.findings import Fleet

MOST_SKIPPED = 5
"""Most skipped recordings listed on the terminal."""


@click.command(short_help="Find cells that drift and joints that wear.")
@click.argument("lake", type=INPUT)
@click.option(
    "--robot",
    "robots",
    multiple=True,
    metavar="[CELLS=]FILE",
    help="Description of the robots of these cells (weld-*=mh12.yaml), or of all; else the nearest robot.yaml above.",
)
@click.option("--weeks", type=click.IntRange(min=6), help="Number of last weeks to use.")
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
    help="Smallest change that is reported, as a share.",
)
@click.option("--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder to write.")
@click.option("--json", "as_json", is_flag=True, help="Print fleet.json.")
@with_scheduler
@with_columns
@with_progress
def fleet(lake: Path, out: Path, as_json: bool, **asked: Any) -> None:
    """Find the cells of a LAKE of recordings that drift, and the joints that wear.

    LAKE contains a folder of .mcap, .parquet or .csv files for each cell, or is the lake of the historian. Writes
    fleet.json and report.html (one page).
    """
    from cellwatt_plugins.fleet.api import fleet as compare
    from cellwatt_plugins.fleet.report import report_of

    found = compare(lake, **asked)
    write_file(out / "fleet.json", json.dumps(found.as_json(), indent=1))
    with stage("writing the report"):
        report_of(found, lake.resolve().name).write(out / "report.html")
    written = f"written to {out}: fleet.json, report.html"
    click.echo(json.dumps(found.as_json()) if as_json else f"{_in_words(found)}\n{written}")


def _in_words(found: Fleet) -> str:
    lines = [found.headline]
    lines += [f"  • {f.statement}" for f in found.findings]
    lines += [f"  ? {c.cell}: {c.statement}" for c in found.cells if c.statement]
    lines += [f"  note: {note}" for note in found.notes]
    lines += [f"  skipped {s.place}: {s.why}" for s in found.skipped[:MOST_SKIPPED]]
    more = len(found.skipped) - MOST_SKIPPED
    lines += [f"  skipped {more} more, all in fleet.json"] if more > 0 else []
    return "\n".join(lines)
