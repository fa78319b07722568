"""``cellwatt import``: published recordings of others as a recording of cellwatt."""

from __future__ import annotations

import json
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import click

from cellwatt.commands.numbers import FiniteRange
from cellwatt.commands.quiet import with_progress
from cellwatt.errors import RecordingError
from cellwatt.imports import Part, read_map, read_parts, write_recording
from cellwatt.progress import steps


@click.command("import", short_help="Write published data sets as recordings.")
@click.argument("form", metavar="FORMAT")
@click.argument("files", nargs=-1, required=True, metavar="FILE...", type=click.Path(exists=True, path_type=Path))
@click.option("--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder of the recording.")
@click.option("--rate", type=FiniteRange(0.1, 10_000), default=100.0, show_default=True, help="Hz of the frames.")
@click.option("--parts", type=click.IntRange(min=1), help="Only the first so many repetitions.")
@click.option("--json", "as_json", is_flag=True, help="Report as one JSON object.")
@with_progress
def command(form: str, files: tuple[Path, ...], out: Path, rate: float, parts: int | None, as_json: bool) -> None:
    """Write FILEs of a published FORMAT as a recording that export, replay, faults and train power can use.

    FORMAT is one that comes with cellwatt (irs-data, irtp-2700, voraus-ad), or a YAML file that says which column is
    which channel.
    """
    columns = read_map(form)
    if out.exists() and any(out.glob("*.mcap*")):
        raise RecordingError(
            f"{out} holds recordings, perhaps of an import that failed: name another folder or empty it"
        )

    def every() -> Iterator[Part]:
        for path in steps(files, "file"):
            yield from steps(read_parts(path, columns), "part")

    counts = write_recording(out, islice(every(), parts), Path(form).stem, rate)
    if as_json:
        click.echo(json.dumps({**counts, "licence": columns.licence, "unverified": columns.unverified}))
        return
    click.echo(
        f"{columns.title}: {counts['parts']} parts, {counts['samples']} samples, {counts['frames']} frames in {out}"
    )
    click.echo(f"licence: {columns.licence}")
    if columns.unverified:
        click.echo(f"not verified: {columns.unverified}")
