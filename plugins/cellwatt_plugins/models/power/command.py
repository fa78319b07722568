"""``cellwatt train power``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import click

from cellwatt.commands.options import INPUT, with_columns, with_progress, with_scheduler
from cellwatt.progress import stage
from cellwatt.report.page import PAGE
from cellwatt_plugins.robot_option import with_robot


@click.command("power")
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...", type=INPUT)
@with_robot
@click.option(
    "--meter", multiple=True, type=INPUT, help="Power (t, power) on the meter's own clock, one file per RECORDING."
)
@click.option("--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder for the model.")
@click.option("--report", "page", type=click.Path(dir_okay=False, path_type=Path), help=PAGE)
@click.option("--json", "as_json", is_flag=True, help="Report as JSON.")
@with_columns
@with_progress
@with_scheduler
def train_power(out: Path, page: Path | None, as_json: bool, **asked: Any) -> None:
    """Train a model of the currents and the supply power of a moving arm, on RECORDINGs of its moves.

    RECORDINGs are tables (Parquet, CSV) with t, q_i, qd_i, current_i and power, and move if a file holds several
    moves; or recordings of cellwatt. Prints the errors of the paper's two methods and of the best model on held-out
    moves, and writes model.onnx (the best model), nls.onnx and scg.onnx (the paper's) and power.json.
    """
    from cellwatt_plugins.models.power import api
    from cellwatt_plugins.models.power.wording import in_words

    model = api.train_power(**asked)
    files = [str(file) for file in model.save(out)]
    if page is not None:
        with stage("writing the report"):
            model.report(page)
        files.append(str(page))
    click.echo(json.dumps(model.as_json()) if as_json else in_words(model.trained, model.moves, files))
