"""``cellwatt doctor``: opens every device read-only and compares measured with declared figures."""

from __future__ import annotations

import asyncio
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from cellwatt.commands import EXIT_FAILED
from cellwatt.commands.check import warn
from cellwatt.commands.options import SECONDS
from cellwatt.commands.ranges import summary
from cellwatt.config import load
from cellwatt.progress.terminal import show_table
from cellwatt.runtime.examine import Examination, examine

COLOUR = {"ok": "green", "warning": "yellow", "failed": "red"}


@click.command(short_help="Compare declared with measured rates of each device.")
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--seconds", type=SECONDS, default=5.0, show_default=True, help="Time to read each device, s.")
@click.option(
    "--patience", type=SECONDS, default=5.0, show_default=True, help="Longest time for a device to answer, s."
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def command(file: Path, seconds: float, patience: float, as_json: bool) -> None:
    """Connect to every device of FILE, read-only, and compare measured with declared rates and channels.

    A device with its own clock is read up to 15 s longer, until the offset of that clock is known.

    Exit code 0: all as declared (warnings allowed); 1: a device failed; 2: FILE is invalid.
    """
    config = load(file)
    if refused := warn(file, config):
        click.echo(f"warning: {refused}", err=True)

    async def all_sources() -> list[Examination]:
        return await asyncio.gather(*(examine(source, seconds, patience) for source in config.sources.values()))

    found = asyncio.run(all_sources())
    if as_json:
        click.echo(json.dumps({e.name: asdict(e) for e in found}))
    else:
        _show(found)
    if any(e.verdict == "failed" for e in found):
        sys.exit(EXIT_FAILED)


def _show(found: list[Examination]) -> None:
    header = ("source", "device", "stream", "declared", "measured", "jitter p99", "clock ±", "lost", "verdict")
    show_table(header, [row for e in found for row in _rows(e)])
    click.echo()
    for e in found:
        for finding in e.findings:
            click.echo(f"{click.style(e.name, fg=COLOUR[e.verdict])}: {finding}")
        for line in summary(e.channels):
            click.echo(click.style(f"  {e.name}: {line}", dim=True))


def _rows(e: Examination) -> list[tuple[str, ...]]:
    """Table rows of a source, one per stream."""
    identity = e.status.get("identity") or {}
    device = " ".join(filter(None, (identity.get(k, "") for k in ("maker", "model", "firmware")))) or "–"
    lost = sum(e.status.get("missed", {}).values()) + sum(e.status.get("dropped", {}).values())
    streams = e.status.get("streams", {})
    if not streams:
        return [(e.name, device, "–", "", "", "", "", "", e.verdict)]
    rows: list[tuple[str, ...]] = []
    for name, figures in streams.items():
        bound = e.status["bounds_ms"][name]
        clock = "–" if bound is None else f"{bound:.2f} ms"
        rows.append((e.name, device, name, *rates(figures), clock, str(lost), e.verdict))
    return rows


def rates(figures: Mapping[str, Any]) -> tuple[str, str, str]:
    """Declared rate, measured rate and jitter of a stream, from its status."""
    declared = f"{figures['nominal_hz']:g} Hz" if figures["nominal_hz"] else "on change"
    measured = "–" if figures["rate_hz"] is None else f"{figures['rate_hz']:.2f} Hz"
    return declared, measured, "–" if figures["jitter_p99_ms"] is None else f"{figures['jitter_p99_ms']:.2f} ms"
