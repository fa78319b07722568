"""``cellwatt disaggregate``.

Pinocchio and scipy are imported when the command runs; if one is missing, the error names the extra to install.
"""

from __future__ import annotations

import json
from dataclasses import fields
from pathlib import Path
from typing import Any

import click

from cellwatt.commands.options import INPUT, with_columns, with_progress, with_scheduler, with_units
from cellwatt.files import write_csv, write_file
from cellwatt.progress import stage
from cellwatt.report.blocks import Table
from cellwatt.units import Units
from cellwatt_plugins.energy.findings import Findings, RunEnergy
from cellwatt_plugins.energy.wording import amount
from cellwatt_plugins.robot_option import with_robot

SHOWN = ("electronics", "brakes", "mechanical", "electrical", "chopper")
"""Names of the groups on the terminal."""


@click.command(short_help="Split a robot's energy by consumer.")
@with_robot
@click.option("--controller", type=INPUT, help="Power with the arm unplugged; not needed if it cannot be unplugged.")
@click.option("--connected", required=True, type=INPUT, help="Power with the arm connected and its brakes on.")
@click.option("--released", required=True, type=INPUT, help="Power with the brakes released and the arm at rest.")
@click.option("--runs", required=True, type=INPUT, help="Folder of SPEED_PAYLOADkg.robot and .analyzer files.")
@click.option("--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder to write.")
@with_units
@click.option("--json", "as_json", is_flag=True, help="Print energy.json.")
@with_columns
@with_progress
@with_scheduler
def disaggregate(out: Path, units: tuple[str, ...], as_json: bool, **asked: Any) -> None:
    """Split a robot's energy by consumer: electronics, brakes, mechanical and electrical losses, chopper.

    Files are Parquet or CSV: t (s) and power (W) of the analyzer; t, q_1 …, qd_1 …, tau_1 … (rad, rad/s, Nm) of the
    robot. Each run repeats one closed path from rest to rest. Writes energy.json, energy.csv and report.html.
    """
    from cellwatt_plugins.energy import api

    outcome, shown = api.disaggregate(**asked), Units().but(units)
    found = outcome.findings
    write_file(out / "energy.json", json.dumps(found.as_json(), indent=1))
    write_table(found, out / "energy.csv")
    with stage("writing the report"):
        outcome.report(out / "report.html", shown)
    written = f"written to {out}: energy.json, energy.csv, report.html"
    click.echo(json.dumps(found.as_json()) if as_json else f"{in_words(found, shown)}\n{written}")


def write_table(found: Findings, path: Path) -> None:
    """Write the runs as CSV, one per line, with the uncertainties in further columns."""
    names = [f.name for f in fields(RunEnergy) if f.name not in ("uncertainty", "notes")]
    unsure = [name for name in names if name in found.runs[0].uncertainty]
    rows: list[list[object]] = [[*names, *(f"{name}_uncertainty" for name in unsure), "notes"]]
    for run in found.runs:
        values = [getattr(run, name) for name in names]
        rows.append([*values, *(run.uncertainty[name] for name in unsure), "; ".join(run.notes)])
    write_csv(path, rows)


def in_words(found: Findings, units: Units) -> str:
    """The findings as text for the terminal, energies and powers in ``units``."""
    power, fixed = units.of("W"), found.fixed
    heads = ("run", f"total {units.of('J').name}", *(f"{group} %" for group in SHOWN))
    head = (
        f"{found.robot}: controller {amount(fixed.controller, power, 2)} {power.name}, "
        f"robot electronics {amount(fixed.robot_electronics, power, 2)} {power.name}, brakes "
        f"{amount(fixed.brakes, power, 2)} ± {amount(fixed.brakes_uncertainty, power, 2)} {power.name}"
    )
    runs = Table(head, heads, [[run.run, amount(run.total, units.of("J")), *_shares(run)] for run in found.runs])
    notes = [*fixed.notes, *found.notes, *(f"{run.run}: {note}" for run in found.runs for note in run.notes)]
    return "\n".join([runs.text(), *(f"  note: {note}" for note in notes)])


def _shares(run: RunEnergy) -> list[str]:
    """Share of each group in the total, percent; electrical losses include the chopper if they cannot be separated."""
    return ["with the other" if energy is None else f"{100 * energy / run.total:.1f}" for energy in run.split]
