"""``cellwatt train static`` and ``plan-poses``."""

from __future__ import annotations

import json
from pathlib import Path

import click

from cellwatt.commands.options import INPUT, with_columns, with_progress, with_scheduler
from cellwatt.progress import stage
from cellwatt.report.page import PAGE
from cellwatt_plugins.robot_option import ROBOT, with_robot


@click.command("static")
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...", type=INPUT)
@with_robot
@click.option("--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder for the models.")
@click.option("--report", "page", type=click.Path(dir_okay=False, path_type=Path), help=PAGE)
@click.option("--json", "as_json", is_flag=True, help="Report as JSON.")
@with_columns
@with_progress
@with_scheduler
def train_static(recordings: tuple[Path, ...], robot: Path, out: Path, page: Path | None, as_json: bool) -> None:
    """Train a model of the torque that an arm needs to hold still, on RECORDINGs of held poses.

    RECORDINGs are tables (Parquet, CSV) with q_i and torque_percent_i or torque_i and a column pose, or recordings
    of the cell in which the poses are recognised. Prints the errors of the published
    methods and of the best model on held-out poses, and the effects that the CAD model lacks.
    """
    from cellwatt_plugins.models.static import api
    from cellwatt_plugins.models.static.wording import in_words

    model = api.train_static(recordings, robot=robot)
    files = model.save(out)
    if page is not None:
        with stage("writing the report"):
            model.report(page)
        files.append(page)
    report = {**model.as_json(), "files": [str(file) for file in files]}
    click.echo(json.dumps(report) if as_json else in_words(model.trained, files))


@click.command("plan-poses")
@click.option("--robot", type=ROBOT, help="The robot's YAML description or its folder (default: a Yaskawa MH12).")
@click.option(
    "--count", default=532, show_default=True, type=click.IntRange(2, 20_000), help="Number of poses; 40 may be enough."
)
@click.option("--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder for the plan.")
@click.option("--json", "as_json", is_flag=True, help="Report as JSON.")
@with_progress
def plan_poses(robot: Path | None, count: int, out: Path, as_json: bool) -> None:
    """Plan poses to hold: spread over the joints' ranges, clear of the arm itself and the floor, with short moves.

    Writes plan.csv, for a program that an operator writes and runs: cellwatt itself moves nothing.
    Try the program at low speed first; the check knows the arm and the floor, not other objects in the cell.
    """
    from cellwatt_plugins.models.static.planning import write_plan

    report = write_plan(robot, count, out)
    click.echo(json.dumps(report.as_json()) if as_json else report.in_words())
