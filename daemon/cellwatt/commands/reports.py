"""``cellwatt reports``: an index of the pages in a folder."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import click


@click.command(short_help="Write an index of the reports in a folder.")
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option(
    "--out", type=click.Path(dir_okay=False, path_type=Path), help="Page to write (default: index.html in FOLDER)."
)
@click.option("--json", "as_json", is_flag=True, help="Print the facts of all pages as one JSON object; write no page.")
def command(folder: Path, out: Path | None, as_json: bool) -> None:
    """Write an index of all reports in FOLDER and below: by kind, the newest first, each with its finding.

    Reports are what --report, plot and disaggregate write, and the pages of alarms. Other HTML files are passed over.
    """
    from cellwatt.report.index import Index

    index = Index.of(folder)
    if as_json:
        pages = [{"path": str(page.path), **asdict(page.facts)} for page in index.pages]
        click.echo(json.dumps({"reports": pages, "broken": list(index.broken)}))
        return
    out = folder / "index.html" if out is None else out
    index.report(out).write(out)
    for text in index.broken:
        click.echo(f"warning: {text}", err=True)
    click.echo(f"wrote {out}: {len(index.pages)} reports")
