"""``cellwatt export``: writes recordings as Parquet or CSV."""

from __future__ import annotations

import json
import re
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from cellwatt.batch import Batch
from cellwatt.commands import FOLDER
from cellwatt.commands.options import INPUT, with_progress, with_scheduler, with_units
from cellwatt.errors import RecordingError
from cellwatt.files import make_folder, write_file
from cellwatt.logs.recorded import open_recording
from cellwatt.record import Recording, messages
from cellwatt.record.header import recorded_section
from cellwatt.record.samples import unchanged
from cellwatt.record.tables import Table
from cellwatt.scheduler import spread
from cellwatt.units import Units

Written = dict[str, Any]
"""Name and row count of a file."""


@click.command(short_help="Write recordings as Parquet or CSV.")
@click.argument("recordings", nargs=-1, required=True, type=INPUT)
@click.option("--out", required=True, type=FOLDER, help="Folder for the tables.")
@click.option("--format", "form", type=click.Choice(["parquet", "csv"]), default="parquet", show_default=True)
@click.option("--frames", "only", flag_value="frames", help="Only the aligned frames.")
@click.option("--raw", "only", flag_value="raw", help="Only the raw samples.")
@click.option("--force", is_flag=True, help="Overwrite tables of an earlier export.")
@with_units
@click.option("--json", "as_json", is_flag=True, help="Print the report as one JSON object.")
@with_scheduler
@with_progress
def command(
    recordings: tuple[Path, ...],
    out: Path,
    form: str,
    only: str | None,
    force: bool,
    units: tuple[str, ...],
    as_json: bool,
) -> None:
    """Write RECORDINGS (files or folders of one cell) as tables.

    Writes one table per raw stream (SOURCE.STREAM), one table of the frames, and results and events as JSON lines.
    Columns have the names of the channels; t is the time in s since the start of the recording, utc_ns the UTC time
    in ns. Results and events are always in SI units.
    """
    recording = open_recording(recordings)
    make_folder(out)
    export = Export(out, form, force, recorded_section(recording.header.settings, "units", Units).but(units))
    parts = spread(export.write, [only] if only else ["raw", "frames", "lines"], "tables", shared=recording)
    written = [file for files, _ in parts for file in files]
    if not written:
        raise recording.lacks_frames()
    if as_json:
        damage = dict.fromkeys([*map(str, recording.damage), *(text for _, found in parts for text in found)])
        report = {"start": recording.start, "end": recording.end, "files": written, "damage": list(damage)}
        click.echo(json.dumps(report))
        return
    for file in written:
        click.echo(f"{out / file['file']}: {file['rows']} rows")


@dataclass(frozen=True)
class Export:
    """One export: its output folder, file format and units."""

    out: Path
    form: str
    force: bool
    units: Units

    def write(self, kind: str, recording: Recording) -> tuple[list[Written], list[str]]:
        """Write the tables of a kind; return name and row count of each file, and the damage found in the recording."""
        written = {"raw": self.raw, "frames": self.frames, "lines": self.lines}[kind](recording)
        return written, list(map(str, recording.damage))

    def raw(self, recording: Recording) -> list[Written]:
        """Write the raw samples, one table per stream, in a single pass over the recording."""
        tables: dict[tuple[str, str], Table] = {}
        with ExitStack() as stack:
            for batch in unchanged(recording.entries(), recording.streams, "export them one by one"):
                if not isinstance(batch, Batch):
                    continue
                key = (batch.source, batch.stream.name)
                if key not in tables:
                    table = self._table(recording, ".".join(key), batch.stream.channels)
                    tables[key] = stack.enter_context(table)
                tables[key].add_batch(batch)
        return [_written(table) for table in tables.values()]

    def frames(self, recording: Recording) -> list[Written]:
        """Write the aligned frames as one table."""
        layout = recording.layout
        if layout is None:
            return []
        with self._table(recording, "frames", layout.channels) as table:
            for frames in recording.frames():
                if frames.layout != layout:
                    raise RecordingError(
                        "the layout of the frames changes within these recordings: export them one by one"
                    )
                table.add_frames(frames)
        return [_written(table)]

    def lines(self, recording: Recording) -> list[Written]:
        """Write results and events as JSON lines."""
        written: list[Written] = []
        for name, items in {"results.jsonl": recording.results(), "events.jsonl": recording.events()}.items():
            path, lines = self._path(name), [_line(item) for item in items]
            if lines:
                write_file(path, b"".join(lines))
                written.append({"file": name, "rows": len(lines)})
        return written

    def _table(self, recording: Recording, name: str, channels: Any) -> Table:
        plain = re.sub(r"[^\w.-]+", "-", name)
        path = self._path(f"{plain}.{self.form}")
        return Table(path, channels, recording.start, recording.header, self.units)

    def _path(self, name: str) -> Path:
        path = self.out / name
        if path.exists() and not self.force:
            raise RecordingError(f"{path} already exists: choose another folder, or --force to overwrite")
        return path


def _written(table: Table) -> Written:
    return {"file": table.path.name, "rows": table.rows}


def _line(item: messages.Message) -> bytes:
    return b'{"type":"%s",' % type(item).__name__.lower().encode() + messages.encode(item)[1:] + b"\n"
