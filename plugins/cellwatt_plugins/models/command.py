"""``cellwatt train``: one command a kind of model; ``cellwatt predict``: a trained model on a table."""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path
from typing import Final

import click

from cellwatt.commands.options import INPUT, Input, with_columns, with_progress
from cellwatt.errors import CellwattError

KINDS: Final = {
    "pattern": "cellwatt_plugins.faults.paper.train_pattern:train_pattern",
    "plan-poses": "cellwatt_plugins.models.static.command:plan_poses",
    "power": "cellwatt_plugins.models.power.command:train_power",
    "static": "cellwatt_plugins.models.static.command:train_static",
}
"""Kinds of training: the command's name and its function; imported only when called."""


class _Kinds(click.Group):
    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(KINDS)

    def get_command(self, ctx: click.Context, name: str) -> click.Command | None:
        if name not in KINDS:
            return None
        module, attribute = KINDS[name].split(":")
        command: click.Command = getattr(import_module(module), attribute)
        return command

    def invoke(self, ctx: click.Context) -> object:
        try:
            return super().invoke(ctx)
        except ModuleNotFoundError as error:
            if (error.name or "").startswith("cellwatt"):
                raise
            raise CellwattError(
                f"training needs {error.name}: install it with pip install 'cellwatt[train]'"
            ) from error


@click.group(cls=_Kinds, short_help="Train a model of a robot from recordings.")
def train() -> None:
    """Train a model of a robot from recordings: of its torque at rest, of its power in motion, or of a task's power."""


@click.command(short_help="Run a trained model on a table.")
@click.argument("table", type=INPUT)
@click.option(
    "--model", required=True, type=Input(dir_okay=False, path_type=Path), help="model.onnx that cellwatt train wrote."
)
@click.option("--out", required=True, type=click.Path(path_type=Path), help="Table to write (.parquet or .csv).")
@click.option("--json", "as_json", is_flag=True, help="Report as JSON.")
@with_columns
@with_progress
def predict(table: Path, model: Path, out: Path, as_json: bool) -> None:
    """Run a trained model on the rows of TABLE (Parquet, CSV, or a recording of cellwatt).

    Columns are q_1 …, qd_1 …, torque_1 …, or named as channels (joint_1.position); those that number the rows
    (t, pose, move) are copied. The window of a model starts again where move changes or t jumps.
    """
    from cellwatt_plugins.models.predict import predict_file

    report = predict_file(model, table, out)
    click.echo(json.dumps(report.as_json()) if as_json else report.in_words())
