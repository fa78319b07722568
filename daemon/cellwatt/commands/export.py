"""``cellwatt export``: recordings as Parquet or CSV."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from cellwatt.batch import Batch
from cellwatt.commands.options import INPUT, with_progress, with_scheduler, with_units
from cellwatt.errors import RecordingError
from cellwatt.logs.recorded import open_recording
from cellwatt.record import Recording, messages
from cellwatt.record.header import recorded_section
from cellwatt.record.scan import Damage
from cellwatt.record.tables import Table, write_lines
from cellwatt.scheduler import spread
from cellwatt.units import Units

Written = dict[str, Any]
"""Name and number of rows of a file."""


@click.command(short_help="Write recordings as Parquet or CSV.")
@click.argument("recordings", nargs=-1, required=True, type=INPUT)
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
@with_scheduler
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
    recording = open_recording(recordings)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise RecordingError(f"{out} cannot be made: {error.strerror}") from error
    export = Export(out, form, force, recorded_section(recording.header.settings, "units", Units).but(units))
    written, damage = export.run(recording, only)
    if not written:
        raise recording.lacks_frames()
    if as_json:
        told = [str(d) for d in damage]
        report = {"start": recording.start, "end": recording.end, "files": written, "damage": told}
        click.echo(json.dumps(report))
        return
    for file in written:
        click.echo(f"{out / file['file']}: {file['rows']} rows")


def _refuse_unsigned(recordings: tuple[Path, ...], key: Path) -> None:
    from cellwatt.record.seal import verify

    wrong = [f"{file} {problem}" for file, _, problem in verify(recordings, key) if problem]
    if wrong:
        more = f" ({len(wrong) - 1} more: cellwatt secure verify)" if len(wrong) > 1 else ""
        raise RecordingError(f"nothing is exported: {wrong[0]}{more}")


@dataclass(frozen=True)
class Export:
    """One export: where the tables go, and in which form."""

    out: Path
    form: str
    force: bool
    units: Units

    def run(self, recording: Recording, only: str | None) -> tuple[list[Written], list[Damage]]:
        """Write the requested tables; return name and number of rows of each file, and all damage of the recording."""
        kinds: list[Callable[[Export, Recording], list[Written]]] = []
        kinds += [Export.raw] if only != "frames" else []
        kinds += [Export.frames] if only != "raw" else []
        kinds += [Export.lines] if only is None else []
        parts = spread(_write, [(self, kind) for kind in kinds], "tables", shared=recording)
        damage = list(recording.damage)
        for _, found in parts:
            damage += [d for d in found if d not in damage]
        return [file for written, _ in parts for file in written], damage

    def raw(self, recording: Recording) -> list[Written]:
        """Write the raw samples, one table a stream, in a single pass over the recording."""
        tables: dict[tuple[str, str], Table] = {}
        with ExitStack() as stack:
            for batch in recording.entries():
                if not isinstance(batch, Batch):
                    continue
                key = (batch.source, batch.stream.name)
                if key not in tables:
                    table = self._table(recording, ".".join(key), batch.stream.channels)
                    tables[key] = stack.enter_context(table)
                tables[key].add_batch(batch)
        return [_told(table) for table in tables.values()]

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
        return [_told(table)]

    def lines(self, recording: Recording) -> list[Written]:
        """Write results and events as JSON lines."""
        written: list[Written] = []
        for name, items in {"results.jsonl": recording.results(), "events.jsonl": recording.events()}.items():
            rows = write_lines(self._path(name), map(_line, items))
            written += [{"file": name, "rows": rows}] if rows else []
        return written

    def _table(self, recording: Recording, name: str, channels: Any) -> Table:
        plain = re.sub(r"[^\w.-]+", "-", name)
        path = self._path(f"{plain}.{self.form}")
        return Table(path, channels, recording.start, recording.header, self.units)

    def _path(self, name: str) -> Path:
        path = self.out / name
        if path.exists() and not self.force:
            raise RecordingError(f"{path} is there already: choose another folder, or --force to overwrite")
        return path


def _write(
    part: tuple[Export, Callable[[Export, Recording], list[Written]]], recording: Recording
) -> tuple[list[Written], list[Damage]]:
    """Write one kind of tables; return the files, and the damage that was met."""
    export, kind = part
    return kind(export, recording), list(recording.damage)


def _told(table: Table) -> Written:
    return {"file": table.path.name, "rows": table.rows}


def _line(item: messages.Message) -> bytes:
    return b'{"type":"%s",' % type(item).__name__.lower().encode() + messages.encode(item)[1:]
