"""``cellwatt plot``: draws a recording as one self-contained HTML page."""

from __future__ import annotations

import json
from pathlib import Path

import click

from cellwatt.commands import FILE
from cellwatt.commands.options import FINITE, INPUT, with_progress, with_units
from cellwatt.logs.opening import is_log
from cellwatt.logs.recorded import open_recording
from cellwatt.progress import stage
from cellwatt.record.header import recorded_section
from cellwatt.tables import is_table
from cellwatt.units import Units


@click.command(short_help="Draw a recording as an HTML page.")
@click.argument("recording", nargs=-1, required=True, type=INPUT)
@click.option("--out", type=FILE, default=Path("plot.html"), show_default=True)
@click.option("--from", "start", type=FINITE, help="First second to show, from the recording's start.")
@click.option("--to", "end", type=FINITE, help="Last second to show.")
@click.option("--channel", "channels", multiple=True, help="Only channels whose name contains this; may be repeated.")
@with_units
@click.option("--json", "as_json", is_flag=True, help="Print the report as one JSON object.")
@with_progress
def command(
    recording: tuple[Path, ...],
    out: Path,
    start: float | None,
    end: float | None,
    channels: tuple[str, ...],
    units: tuple[str, ...],
    as_json: bool,
) -> None:
    """Draw RECORDING (files or folders) as an HTML page: frames by quantity, with intervals, tasks and alarms.

    If the recording has no intervals, the segment stage finds them now, with its default settings. Of a table (CSV,
    Parquet) every column is drawn, in the units of the file.
    """
    if all(is_table(path) and not is_log(path) for path in recording):
        from cellwatt.tables import page as tables_page

        page = tables_page.report(recording, start, end, channels)
    else:
        from cellwatt.runtime.plotted import report

        opened = open_recording(recording)
        chosen = recorded_section(opened.header.settings, "units", Units).but(units)
        page = report(opened, start, end, channels, chosen)
    with stage(f"writing {out}"):
        page.write(out)
    click.echo(json.dumps({"file": str(out)}) if as_json else f"wrote {out}")
