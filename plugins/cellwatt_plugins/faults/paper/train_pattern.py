"""``cellwatt train pattern``: writes the power equation of each task."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import click
import numpy as np

from cellwatt.commands.options import INPUT, with_progress, with_scheduler
from cellwatt.errors import ModelError
from cellwatt.scheduler import spread
from cellwatt_plugins.faults.paper import equation
from cellwatt_plugins.faults.paper.bevf import ORDERS, fit, rms
from cellwatt_plugins.faults.paper.pattern import cycle_pattern
from cellwatt_plugins.faults.reference import Variant, load

PUBLISHED: Final = {"BEVF 24": 19.26, "BEVF 34": 6.44, "BEVF 44": 0.2715}
"""rms errors (19) published for the paper's pick-and-place task, W."""


@click.command("pattern")
@click.argument("reference", metavar="REFERENCE", type=INPUT)
@click.option("--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder for equations.")
@click.option("--order", default=ORDERS[-1], show_default=True, type=click.IntRange(2, 200), help="Poles; even.")
@click.option("--json", "as_json", is_flag=True, help="Report as JSON.")
@with_progress
@with_scheduler
def train_pattern(reference: Path, out: Path, order: int, as_json: bool) -> None:
    """Write the power pattern of each task of REFERENCE as an equation, by vector fitting (BEVF).

    REFERENCE is a file written by `cellwatt reference`. The stage faults_by_paper reads the folder given as `equations`
    and compares power with the equations instead of the mean of healthy cycles. Prints the error of each fit.
    """
    learned = load(reference)
    wanted = [(task.name, variant) for task in learned.tasks for variant in task.variants]
    if not wanted:
        raise ModelError(f"reference {reference}: has no task to write an equation of")
    found = [_written(*each, out) for each in spread(_fitted, wanted, "equations", shared=order)]
    click.echo(json.dumps(found) if as_json else "\n\n".join(map(_in_words, found)))


def _fitted(known: tuple[str, Variant], order: int) -> tuple[dict[str, Any], equation.PowerEquation]:
    """The report on one task at one speed, errors and spread in W, and its equation of the given order."""
    task, variant = known
    t, power = cycle_pattern(variant)
    orders = {order, *(each for each in ORDERS if len(t) > 2 * each)}
    fits = {each: fit(t, power, order=each) for each in sorted(orders)}
    about = {
        "task": task,
        "speed": variant.speed,
        "seconds": float(t[-1]),
        "points": len(t),
        "spread": float(np.std(power)),
        "rms": {f"BEVF {each}": rms(power, fitted.power(t)) for each, fitted in fits.items()},
    }
    return about, fits[order].model_copy(update={"task": task, "speed": variant.speed})


def _written(about: Mapping[str, Any], made: equation.PowerEquation, out: Path) -> dict[str, Any]:
    file = out / f"{re.sub(r'[^A-Za-z0-9_-]', '_', about['task'])}-{about['speed']:g}.yaml"
    equation.save(made, file)
    return {**about, "file": str(file)}


def _in_words(found: Mapping[str, Any]) -> str:
    head = (
        f"{found['task']} at speed {found['speed']:.2f}: {found['points']} points, {found['seconds']:.1f} s, "
        f"spread {found['spread']:.1f} W; rms error of each fit, W (in the paper)"
    )
    rows = [
        f"  {name:<15} {error:8.2f}" + (f" ({PUBLISHED[name]:.2f})" if name in PUBLISHED else "")
        for name, error in found["rms"].items()
    ]
    return "\n".join([head, *rows, f"  written to {found['file']}"])
