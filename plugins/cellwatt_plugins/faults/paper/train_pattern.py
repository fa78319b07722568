"""``cellwatt train pattern``: the power equation of each task."""

from __future__ import annotations

import json
import re
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Final

import click
import numpy as np

from cellwatt.commands.options import INPUT, with_progress, with_scheduler
from cellwatt.errors import ModelError
from cellwatt.scheduler import spread
from cellwatt_plugins.faults.paper import equation
from cellwatt_plugins.faults.paper.bevf import ORDERS, PowerEquation, fit, rms
from cellwatt_plugins.faults.paper.pattern import cycle_pattern
from cellwatt_plugins.faults.reference import Variant, load

PUBLISHED: Final = {"BEVF 24": 19.26, "BEVF 34": 6.44, "BEVF 44": 0.2715}
"""rms errors (19) of the paper's pick-and-place, W."""


@dataclass(frozen=True)
class Fitted:
    """One task at one speed: ``rms`` error (19) of each fit, W, beside the ``spread`` of the pattern, W."""

    task: str
    speed: float
    seconds: float
    points: int
    spread: float
    rms: dict[str, float]
    file: str


@click.command("pattern")
@click.argument("reference", metavar="REFERENCE", type=INPUT)
@click.option("--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder for equations.")
@click.option("--order", default=ORDERS[-1], show_default=True, type=click.IntRange(2, 200), help="Poles; even.")
@click.option("--json", "as_json", is_flag=True, help="Report as JSON.")
@with_progress
@with_scheduler
def train_pattern(reference: Path, out: Path, order: int, as_json: bool) -> None:
    """Write the power pattern of each task of REFERENCE as an equation, by vector fitting (BEVF).

    REFERENCE is a file made by `cellwatt reference`. The stage faults_by_paper takes the folder as `equations` and
    compares power with them in place of the mean of healthy cycles. Prints how well they fit.
    """
    learned = load(reference)
    wanted = [(task.name, variant) for task in learned.tasks for variant in task.variants]
    if not wanted:
        raise ModelError(f"reference {reference}: has no task to write an equation of")
    found = [_written(*each, out) for each in spread(_fitted, wanted, "equations", shared=order)]
    click.echo(json.dumps([asdict(each) for each in found]) if as_json else "\n\n".join(map(_in_words, found)))


def _fitted(known: tuple[str, Variant], order: int) -> tuple[Fitted, PowerEquation]:
    """Fit one task at one speed; the equation of the order that was asked for."""
    task, variant = known
    t, power = cycle_pattern(variant)
    fits: dict[int, PowerEquation] = {}
    for each in sorted({*ORDERS, order}):
        if each == order or len(t) > 2 * each:  # an order that nobody asked for is left out where points are few
            fits[each] = fit(t, power, order=each)
    errors = {f"BEVF {each}": rms(power, fitted.power(t)) for each, fitted in fits.items()}
    found = Fitted(task, variant.speed, float(t[-1]), len(t), float(np.std(power)), errors, "")
    return found, replace(fits[order], task=task, speed=variant.speed)


def _written(fitted: Fitted, made: PowerEquation, out: Path) -> Fitted:
    file = out / f"{re.sub(r'[^A-Za-z0-9_-]', '_', fitted.task)}-{fitted.speed:g}.yaml"
    equation.save(made, file)
    return replace(fitted, file=str(file))


def _in_words(fitted: Fitted) -> str:
    head = (
        f"{fitted.task} at speed {fitted.speed:.2f}: {fitted.points} points, {fitted.seconds:.1f} s, "
        f"spread {fitted.spread:.1f} W; rms error of each fit, W (in the paper)"
    )
    rows = [
        f"  {name:<15} {error:8.2f}" + (f" ({PUBLISHED[name]:.2f})" if name in PUBLISHED else "")
        for name, error in fitted.rms.items()
    ]
    return "\n".join([head, *rows, f"  written to {fitted.file}"])
