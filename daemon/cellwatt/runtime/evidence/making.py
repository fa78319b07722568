"""Makes one evidence pack and its page: ``python -m cellwatt.runtime.evidence.making NOTE``, started by the daemon.

The page shows the statement of the alarm, the curves around it, and the clock bounds and losses of the data.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterator, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final

import click
import numpy as np

from cellwatt.errors import CellwattError, RecordingError, why
from cellwatt.frames import Frames
from cellwatt.record import Recording, packs
from cellwatt.record.cut import Cut, cut
from cellwatt.record.header import recorded_section
from cellwatt.record.packs import Due
from cellwatt.record.survey import utc
from cellwatt.report import Block, Notes, Provenance, Report, Section, Table, Tile
from cellwatt.report.blocks import Html
from cellwatt.report.drawing import stretch
from cellwatt.report.numbers import number
from cellwatt.report.svg import Drawn
from cellwatt.report.theme import FOUND
from cellwatt.results import Alarm, Prediction
from cellwatt.runtime.plotted import channels_over_time
from cellwatt.units import Units, figure_named

MOST_POINTS: Final = 1600
"""Largest number of points of a curve: 1.5 per pixel."""
MOST_PANELS: Final = 6
LEAD: Final = (
    "Yellow: from the first evidence to the alarm. Other bands: intervals, labelled with the joints that move. "
    "Dotted lines: alarms raised (red) and cleared (green)."
)


@click.command()
@click.argument("note", type=click.Path(dir_okay=False, path_type=Path))
@click.option("--reserve", default=0.0, help="Bytes of the disk to leave free.")
def main(note: Path, reserve: float) -> None:
    """Cut the pack described in NOTE out of the record and write its page; report it as JSON."""
    try:
        due = packs.read_due(note)
        pack = note.with_name(f"{due.name}.mcap")
        made = cut(note.parent.parent, due.cell, due.start, due.end, pack, reserve=reserve)
        problem = _page(due, made)
    except (CellwattError, OSError, ValueError) as error:
        click.echo(why(error) if isinstance(error, OSError) else str(error), err=True)
        sys.exit(1)
    plain = {key: value for key, value in asdict(made).items() if key in ("start", "end", "messages", "size", "lost")}
    click.echo(json.dumps({**plain, "problem": problem}))


def _page(due: Due, made: Cut) -> str:
    """Write the page; return the reason if that fails, as the pack is useful without its page."""
    try:
        report(Recording.open(made.path), due, made).write(packs.page_of(made.path))
    except CellwattError as error:
        return f"the page of {made.path.name} cannot be created: {error}"
    return ""


# the page ---------------------------------------------------------------------------------------


def report(pack: Recording, due: Due, made: Cut) -> Report:
    """Make the page of a pack. Raises ``RecordingError`` if the pack cannot be read."""
    alarm, header = due.alarms[0], pack.header
    where = [" or ".join(map(str, (f"Joint {alarm.joint}", *alarm.alternatives)))] if alarm.joint else []
    where += [alarm.source] if alarm.source else []
    return Report(
        name=f"{header.site}/{header.cell}",
        subject=f"alarm {alarm.kind}{f', joint {alarm.joint}' if alarm.joint else ''}, {utc(alarm.time)}",
        facts=[utc(alarm.time), alarm.id, alarm.kind, alarm.severity],
        badge=" · ".join(where),
        verdict=alarm.statement,
        tone="open" if alarm.severity == "error" else "part",
        tiles=list(_tiles(alarm)),
        sections=[
            Section("Around the alarm", _pictures(pack, alarm), LEAD),
            Section("Evidence of the alarm", _evidence(alarm)),
            Section("Other alarms in this time", _others(pack, due)),
            Section("Clocks and losses", _trust(pack, made)),
            Section("Files", _files(made)),
        ],
        provenance=Provenance({}, "", {}),
    )


def _tiles(alarm: Alarm) -> Iterator[Tile]:
    """Residuals with their limits, if the alarm has them; otherwise the first figures of its evidence."""
    evidence = {key: value for key, value in alarm.evidence.items() if _is_number(value)}
    for key in [key for key in evidence if "residual" in key] or list(evidence)[:3]:
        limit = evidence.get(key.replace("residual", "limit")) if "residual" in key else None
        remark = f"limit {_figure(key, limit)[1]}" if limit is not None else ""
        yield Tile(*_figure(key, evidence[key]), remark, "bad")


def _pictures(pack: Recording, alarm: Alarm) -> list[Block]:
    try:
        frames = pack.frames_table()
    except RecordingError as error:
        return [f"No curves: {error}."]
    wanted = _channels(frames, alarm)
    if not len(frames) or not wanted:
        return ["No curves: no frames of these channels were recorded."]
    since, units = (alarm.time, "the alarm"), recorded_section(pack.header.settings, "units", Units)
    figure = channels_over_time(pack, frames, 0, len(frames), wanted, units, since=since, most=MOST_POINTS)
    rows = list(figure.rows)[:MOST_PANELS]
    first = float(max(alarm.since, frames.time[0]) - alarm.time) * 1e-9
    marked = [[replace(panel, marks=[stretch(first, 0.0, FOUND, 0.3), *panel.marks])] for (panel,) in rows]
    blocks: list[Block] = [Drawn(replace(figure, rows=marked, heights=list(figure.heights)[: len(rows)]))]
    models = sorted({p.model for p in pack.results(Prediction)})
    if models:
        blocks.append(f"Outputs of {', '.join(models)} are in the pack, under /prediction.")
    return blocks


def _channels(frames: Frames, alarm: Alarm) -> list[str]:
    """Names of the channels that the alarm concerns: those of its joint and the power, else of its source, else all."""
    continuous = [c for c in frames.layout.channels if c.kind != "discrete"]
    own = [c for c in continuous if alarm.source is None or c.source == alarm.source]
    if alarm.joint:
        joint = [c.name for c in own if f"joint_{alarm.joint}." in c.name]
        power = [c.name for c in continuous if c.unit == "W" and c.name not in joint]
        if joint:
            return [*power, *joint]
    return [c.name for c in own or continuous]


def _evidence(alarm: Alarm) -> list[Block]:
    rows = [_figure(key, value) for key, value in alarm.evidence.items()]
    rows += [("first evidence", utc(alarm.since)), ("raised", utc(alarm.time))]
    rows += [("stage", alarm.stage or "the daemon itself")]
    if alarm.interval is not None:
        rows.append(("interval", str(alarm.interval)))
    if alarm.alternatives:
        rows.append(("other joints that explain it as well", ", ".join(map(str, alarm.alternatives))))
    return [Table("Evidence", (), rows)]


def _others(pack: Recording, due: Due) -> list[Block]:
    first = due.alarms[0]
    others = [a for a in pack.alarms() if a.id != first.id or not a.active]
    rows = [
        (
            f"{(a.time - first.time) * 1e-9:+.2f} s".replace("-", "−"),
            a.severity if a.active else "cleared",
            a.id,
            a.statement,
        )
        for a in others
    ]
    note = [f"{due.more} more alarms are in the pack."] if due.more else []
    return [*([Table("Other alarms", ("at", "severity", "alarm", "statement"), rows)] if rows else []), *note]


def _trust(pack: Recording, made: Cut) -> list[Block]:
    """Clock bounds and losses from the last health in the pack, and the data that the pack lacks."""
    last: Mapping[str, Any] = {}
    for health in pack.health():
        last = health.status
    rows = []
    for name, source in last.get("sources", {}).items():
        bounds = [float(c["bound_ns"]) * 1e-6 for c in source.get("clocks", {}).values()]
        lost = {**source.get("missed", {}), **source.get("dropped", {})}
        rows.append(
            (
                name,
                source.get("state", "unknown"),
                f"± {number(max(bounds))} ms" if bounds else "–",
                str(source.get("received", "–")),
                ", ".join(f"{n} {why}" for why, n in lost.items()) or "none",
            )
        )
    heads = ("source", "state", "bound of the clock", "samples since the start", "lost since the start")
    table: list[Block] = [Table("Clocks and losses", heads, rows)] if rows else []
    notes = [f"Missing in this pack: {text}" for text in made.lost]
    refused = (last.get("recorder") or {}).get("drops", {})
    notes += [f"Not recorded: {n} of {topic}, because the disk was full or slow" for topic, n in refused.items()]
    return [*table, Notes(notes)] if rows or notes else []


def _files(made: Cut) -> list[Block]:
    with made.path.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    names = [path.name for path in made.sources]
    sources = names if len(names) <= 4 else [*names[:2], f"{len(names) - 3} more", names[-1]]
    rows = [
        ("pack", made.path.name),
        ("from, to", f"{utc(made.start)} to {utc(made.end)}"),
        ("content", f"{made.messages} messages, {made.size / 1e6:.1f} MB"),
        ("SHA-256", digest),
        ("cut from", ", ".join(sources)),
    ]
    opens = Html(f"<p>Open it as any recording: <code>cellwatt plot {made.path.name}</code>.</p>")
    return [Table("Files", (), rows), opens]


def _is_number(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _figure(key: str, value: Any) -> tuple[str, str]:
    """Name of a figure, and its value with its unit."""
    name, unit = figure_named(key)
    return name, f"{number(float(value))} {unit}".rstrip() if _is_number(value) else str(value)


if __name__ == "__main__":
    main()
