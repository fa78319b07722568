"""``cellwatt export``: recordings as Parquet or CSV."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import click

from cellwatt.batch import Batch
from cellwatt.commands.quiet import with_progress
from cellwatt.commands.units import recorded_units, with_units
from cellwatt.errors import RecordingError
from cellwatt.progress import stage
from cellwatt.record import Recording, messages
from cellwatt.record.encoder import FRAME_TOPIC
from cellwatt.record.tables import Table, write_lines
from cellwatt.units import Units


@click.command()
@click.argument("recordings", nargs=-1, required=True, type=click.Path(exists=True, path_type=Path))
@click.option("--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder for the tables.")
@click.option("--format", "form", type=click.Choice(["parquet", "csv"]), default="parquet", show_default=True)
@click.option("--frames", "only", flag_value="frames", help="Only the aligned frames.")
@click.option("--raw", "only", flag_value="raw", help="Only the raw samples.")
@click.option("--force", is_flag=True, help="Overwrite tables of an earlier export.")
@click.option(
    "--verify", metavar="KEY", type=click.Path(path_type=Path), help="Only what the cell with this key signed."
)
@with_units
@click.option("--json", "as_json", is_flag=True, help="Report as one JSON object.")
@with_progress
def command(
    recordings: tuple[Path, ...],
    out: Path,
    form: str,
    only: str | None,
    force: bool,
    verify: Path | None,
    units: tuple[str, ...],
    as_json: bool,
) -> None:
    """Write RECORDINGS (files or folders of one cell) as tables.

    One table for each raw stream (SOURCE.STREAM), one of the frames, and results and events as JSON lines.
    Columns are named like the channels; t is s since the start of the recording, utc_ns the time itself. Results and
    events are in SI units always.
    """
    if verify is not None:
        _refuse_unsigned(recordings, verify)
    recording = Recording.open(recordings)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{out} cannot be made: {error.strerror}") from error
    export = Export(recording, out, form, force, recorded_units(recording.header.settings, units))
    written = export.run(only)
    if as_json:
        damage = [str(d) for d in recording.damage]
        report = {"start": recording.start, "end": recording.end, "files": written, "damage": damage}
        click.echo(json.dumps(report))
        return
    for file in written:
        click.echo(f"{out / file['file']}: {file['rows']} rows")
    if not written:
        click.echo("nothing to export")


def _refuse_unsigned(recordings: tuple[Path, ...], key: Path) -> None:
    from cellwatt.record.seal import verify

    wrong = [f"{file} {problem}" for file, _, problem in verify(recordings, key) if problem]
    if wrong:
        more = f" ({len(wrong) - 1} more: cellwatt secure verify)" if len(wrong) > 1 else ""
        raise RecordingError(f"nothing is exported: {wrong[0]}{more}")


class Export:
    """One export: every table is written in a single pass over the recording."""

    def __init__(self, recording: Recording, out: Path, form: str, force: bool, units: Units) -> None:
        self._recording = recording
        self._out = out
        self._form = form
        self._force = force
        self._units = units

    def run(self, only: str | None) -> list[dict[str, Any]]:
        """Write the requested tables; return name and number of rows of each file."""
        written: list[dict[str, Any]] = []
        counts = self._recording.counts
        frames = 0 if only == "raw" else counts.get(FRAME_TOPIC, 0)
        raw = 0 if only == "frames" else sum(n for topic, n in counts.items() if topic.startswith("/raw/"))
        with stage("", frames + raw):
            if only != "frames":
                with stage("raw samples", 1, share=raw):
                    written += self._raw()
            if only != "raw":
                with stage("frames", 1, share=frames):
                    written += self._frames()
        if only is None:
            kinds = {"results.jsonl": self._recording.results(), "events.jsonl": self._recording.events()}
            for name, items in kinds.items():
                rows = write_lines(self._path(name), map(_line, items))
                written += [{"file": name, "rows": rows}] if rows else []
        return written

    def _raw(self) -> Iterator[dict[str, Any]]:
        tables: dict[tuple[str, str], Table] = {}
        with ExitStack() as stack:
            for batch in self._recording.entries():
                if not isinstance(batch, Batch):
                    continue
                key = (batch.source, batch.stream.name)
                if key not in tables:
                    table = self._table(".".join(key), batch.stream.channels)
                    tables[key] = stack.enter_context(table)
                tables[key].add_batch(batch)
        return (_told(table) for table in tables.values())

    def _frames(self) -> list[dict[str, Any]]:
        layout = self._recording.layout
        if layout is None:
            return []
        with self._table("frames", layout.channels) as table:
            for frames in self._recording.frames():
                if frames.layout != layout:
                    raise RecordingError(
                        "the layout of the frames changes within these recordings: export them one by one"
                    )
                table.add_frames(frames)
        return [_told(table)]

    def _table(self, name: str, channels: Any) -> Table:
        plain = re.sub(r"[^\w.-]+", "-", name)
        path = self._path(f"{plain}.{self._form}")
        return Table(path, channels, self._recording.start, self._recording.header, self._units)

    def _path(self, name: str) -> Path:
        path = self._out / name
        if path.exists() and not self._force:
            raise RecordingError(f"{path} is there already: choose another folder, or --force to overwrite")
        return path


def _told(table: Table) -> dict[str, Any]:
    return {"file": table.path.name, "rows": table.rows}


def _line(item: messages.Message) -> bytes:
    return b'{"type":"%s",' % type(item).__name__.lower().encode() + messages.encode(item)[1:]
