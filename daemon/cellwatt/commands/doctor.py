"""``cellwatt doctor``: opens every device read-only and says what works."""

from __future__ import annotations

import asyncio
import json
import sys
from dataclasses import asdict
from pathlib import Path

import click
from rich.console import Console
from rich.table import Table

from cellwatt.batch import Batch
from cellwatt.commands import EXIT_FAILED
from cellwatt.config import load
from cellwatt.runtime.examine import Examination, examine
from cellwatt.runtime.examine_meters import examine_meters

COLOUR = {"ok": "green", "warning": "yellow", "failed": "red"}


@click.command()
@click.argument("file", type=click.Path(path_type=Path))
@click.option("--seconds", default=5.0, show_default=True, help="How long to read each device.")
@click.option("--patience", default=5.0, show_default=True, help="How long a device may take to answer, s.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def command(file: Path, seconds: float, patience: float, as_json: bool) -> None:
    """Connect to every device of FILE, read-only, and compare what comes with what is declared.

    Where an arm moves for long enough (--seconds 30), it tells what the values of a slow power meter stand for.

    Exit code 0: all as declared (warnings allowed); 1: a device failed; 2: FILE is wrong.
    """
    config = load(file)

    read: dict[str, list[Batch]] = {name: [] for name in config.sources}

    async def all_sources() -> list[Examination]:
        sources = config.sources.items()
        return await asyncio.gather(*(examine(s, seconds, patience, read[name]) for name, s in sources))

    found = asyncio.run(all_sources())
    examine_meters(config, found, read)
    if as_json:
        click.echo(json.dumps({e.name: asdict(e) for e in found}))
    else:
        _show(found)
    if any(e.verdict == "failed" for e in found):
        sys.exit(EXIT_FAILED)


def _show(found: list[Examination]) -> None:
    console = Console()
    table = Table(box=None, header_style="bold")
    for title in ("source", "device", "stream", "declared", "measured", "jitter p99", "clock ±", "lost", "verdict"):
        table.add_column(title)
    for e in found:
        identity = e.status.get("identity") or {}
        device = " ".join(identity.get(k, "") for k in ("maker", "model", "firmware")).strip() or "–"
        verdict = f"[{COLOUR[e.verdict]}]{e.verdict}[/]"
        lost = sum(e.status.get("missed", {}).values()) + sum(e.status.get("dropped", {}).values())
        streams = e.status.get("streams", {})
        if not streams:
            table.add_row(e.name, device, "–", "", "", "", "", "", verdict)
        for name, figures in streams.items():
            clock = e.status["clocks"].get(name)
            bound = f"{clock['bound_ns'] * 1e-6:.2f} ms" if clock else "half round trip"
            measured = "–" if figures["rate_hz"] is None else f"{figures['rate_hz']:.1f} Hz"
            jitter = "–" if figures["jitter_p99_ms"] is None else f"{figures['jitter_p99_ms']:.2f} ms"
            declared = f"{figures['nominal_hz']:g} Hz" if figures["nominal_hz"] else "on change"
            table.add_row(e.name, device, name, declared, measured, jitter, bound, str(lost), verdict)
    console.print(table)
    for e in found:
        for finding in e.findings:
            console.print(f"[{COLOUR[e.verdict]}]{e.name}[/]: {finding}", highlight=False)
        for c in e.channels:
            span = "no number" if c.low is None else f"{c.low:.6g} … {c.high:.6g} {c.unit}"
            console.print(f"  {e.name}.{c.name}: {span}", highlight=False, style="dim")
