"""``cellwatt replay``: runs a recording through the same aligner and stages as live data."""

from __future__ import annotations

import json
import sys
from collections import Counter, deque
from collections.abc import Iterable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from cellwatt.commands import EXIT_FAILED, FILE
from cellwatt.commands.options import INPUT, with_progress
from cellwatt.config import CellConfig, FrameSettings, load
from cellwatt.errors import RecordingError
from cellwatt.frames import Frames
from cellwatt.logs.recorded import open_recording
from cellwatt.outlets.zenoh.messages import encode_json
from cellwatt.progress import aside
from cellwatt.record import Recording
from cellwatt.record.header import recorded_section
from cellwatt.record.samples import unchanged
from cellwatt.results import Alarm, Result
from cellwatt.runtime.assemble import layout_of, make_chains
from cellwatt.runtime.replaying import Comparison, compare, replay_frames, run_stages


@click.command(short_help="Run a recording through frames and stages again.")
@click.argument("recording", nargs=-1, required=True, type=INPUT)
@click.option(
    "--settings",
    type=FILE,
    help="Settings file with the frames and stages to use (default: frames as recorded, no stages).",
)
@click.option("--verify", is_flag=True, help="Compare the frames with the recorded ones; exit code 1 if a bit differs.")
@click.option("--json", "as_json", is_flag=True, help="Print results as JSON lines, then the summary as one object.")
@with_progress
def command(recording: tuple[Path, ...], settings: Path | None, verify: bool, as_json: bool) -> None:
    """Align the raw samples of RECORDING (files or folders of one session) to frames and run the stages on them."""
    opened = open_recording(recording)
    config = load(settings) if settings is not None else None
    if not opened.has_samples:
        raise opened.lacks_frames()
    _check_sources(opened)
    entries = unchanged(opened.entries(), opened.header.streams, "replay them one by one")
    frames = replay_frames(entries, opened.header.streams, _grid(opened, config))
    chains = [] if config is None else make_chains(config, layout_of(opened.header.streams, config.frames))
    counts = Counter[str]()
    made = _shown(run_stages(frames, chains), counts, as_json)
    held = compare(opened.frames(), made) if verify else None
    deque(made, maxlen=0)
    summary: dict[str, Any] = {"frames": counts.pop("frames", 0), "results": dict(counts)}
    if held is not None:
        summary |= {"verified": asdict(held), "identical": held.identical}
        if not as_json:
            click.echo(_verdict(held))
    if as_json:
        click.echo(json.dumps(summary))
    else:
        click.echo(f"{summary['frames']} frames, results: {summary['results'] or 'none'}")
    if held is not None and not held.identical:
        sys.exit(EXIT_FAILED)


def _grid(recording: Recording, config: CellConfig | None) -> FrameSettings:
    if config is not None:
        return config.frames
    try:
        return recorded_section(recording.header.settings, "frames", FrameSettings)
    except RecordingError as error:
        raise RecordingError(f"{error}: give them with --settings") from error


def _check_sources(recording: Recording) -> None:
    """Raise ``RecordingError`` if a later file has streams that the first file does not declare."""
    declared = {(source, s.name) for source, streams in recording.header.streams.items() for s in streams}
    if new := {(source, s.name) for source, streams in recording.streams.items() for s in streams} - declared:
        names = ", ".join(sorted(f"{source}.{stream}" for source, stream in new))
        raise RecordingError(f"the sources change within these recordings ({names}): replay them one by one")


def _shown(items: Iterable[Frames | Result], counts: Counter[str], as_json: bool) -> Iterator[Frames]:
    """Yield the frames, print the results, and count frames and results of each kind."""
    for item in items:
        if isinstance(item, Frames):
            counts["frames"] += len(item)
            yield item
            continue
        kind = type(item).__name__.lower()
        counts[kind] += 1
        if as_json:
            with aside():
                click.echo(encode_json({"kind": kind, **asdict(item)}))
        elif isinstance(item, Alarm):
            with aside():
                click.echo(f"{item.severity if item.active else 'cleared'}: {item.statement}")


def _verdict(held: Comparison) -> str:
    if held.identical:
        return f"identical: {held.equal} frames agree in every bit"
    return (
        f"not identical: {held.equal} frames agree, {held.different} differ (first at {held.first_difference} ns), "
        f"{held.only_recorded} only recorded, {held.only_replayed} only replayed"
    )
