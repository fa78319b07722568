"""``cellwatt train static``, ``plan-poses`` and ``collect``."""

from __future__ import annotations

import json
from pathlib import Path

import click

from cellwatt.commands.inputs import INPUT
from cellwatt.commands.numbers import FINITE, FiniteRange
from cellwatt.commands.quiet import with_progress
from cellwatt.commands.scheduling import with_scheduler
from cellwatt.progress import aside, stage
from cellwatt.report.page import PAGE

FILE = click.Path(exists=True, path_type=Path)


@click.command("static")
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...", type=INPUT)
@click.option("--robot", required=True, type=INPUT, help="The robot's YAML description, or the folder that holds it.")
@click.option("--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder for the models.")
@click.option("--report", "page", type=click.Path(dir_okay=False, path_type=Path), help=PAGE)
@click.option("--json", "as_json", is_flag=True, help="Report as JSON.")
@with_progress
@with_scheduler
def train_static(recordings: tuple[Path, ...], robot: Path, out: Path, page: Path | None, as_json: bool) -> None:
    """Make a model of the torque that an arm needs to hold still, from RECORDINGs of held poses.

    RECORDINGs are tables (Parquet, CSV) with q_i and torque_percent_i or torque_i and a column pose, what
    `train collect` has written, or recordings in which the poses are recognised. Prints how the published methods and
    the best model do on poses that they have not seen, what the arm has and its CAD model lacks, and whether more
    poses would help.
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
@click.option("--robot", type=FILE, help="The robot's YAML description or its folder (default: a Yaskawa MH12).")
@click.option(
    "--count", default=532, show_default=True, type=click.IntRange(2, 20_000), help="Poses; 40 may be enough."
)
@click.option("--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder for plan and job.")
@click.option("--cell", type=FILE, help="Cell whose yaskawa source says what the encoders count; for the job.")
@click.option("--source", help="That source, where the cell has several.")
@click.option("--speed", default=25.0, show_default=True, type=FiniteRange(0.01, 100), help="Of the job, per cent.")
@click.option("--hold", default=3.0, show_default=True, type=FiniteRange(2.6, 600), help="Wait in each pose, s.")
@click.option("--name", default="POSES", show_default=True, help="The job's name.")
@click.option("--json", "as_json", is_flag=True, help="Report as JSON.")
@with_progress
def plan_poses(
    robot: Path | None,
    count: int,
    out: Path,
    cell: Path | None,
    source: str | None,
    speed: float,
    hold: float,
    name: str,
    as_json: bool,
) -> None:
    """Plan poses to hold: spread over the joints' ranges, clear of the arm itself and the floor, with short ways.

    Writes plan.csv and, with --cell, an INFORM job that an operator loads and runs: cellwatt itself moves nothing.
    Try the job at low speed first; the check knows the arm and the floor, not what else stands in the cell.
    """
    from cellwatt_plugins.models.static.planning import write_plan

    report = write_plan(robot, count, out, cell, source, speed, hold, name)
    click.echo(json.dumps(report.as_json()) if as_json else report.in_words())


@click.command("collect")
@click.argument("cell", type=FILE)
@click.option("--out", required=True, type=click.Path(dir_okay=False, path_type=Path), help="Table of poses (.csv).")
@click.option("--plan", type=FILE, help="plan.csv of plan-poses: ends when all of it was held.")
@click.option("--source", help="Source with the joints, where several have joints.")
@click.option("--seconds", type=FINITE, help="How long at most (default: until the plan is done, or Ctrl-C).")
@click.option("--json", "as_json", is_flag=True, help="One JSON line a pose.")
@with_progress
def collect(cell: Path, out: Path, plan: Path | None, source: str | None, seconds: float | None, as_json: bool) -> None:
    """Collect the poses that the arm of the running cell CELL (its settings file) holds.

    A pose counts when all joints have rested for 0.5 s and 2 s more. The table is whole after each pose; the same
    command goes on where it stopped, and fetches what was held meanwhile from the cell's record.
    """
    import contextlib
    from dataclasses import asdict

    from cellwatt_plugins.models.static.collect import Progress
    from cellwatt_plugins.models.static.live import collect as run
    from cellwatt_plugins.models.static.live import read_plan

    planned = None if plan is None else read_plan(plan)
    last: Progress | None = None
    with stage("waiting for frames", None if planned is None else len(planned)) as told:

        def tell(progress: Progress) -> None:
            nonlocal last
            last = progress
            told.done = progress.planned
            told.name = f"{progress.held} poses held, {progress.too_short} too short"
            if as_json:
                with aside():
                    click.echo(json.dumps(asdict(progress)))

        with contextlib.suppress(KeyboardInterrupt):
            last = run(cell, source, out, planned, seconds, tell) or last
    if not as_json:
        of_plan = f", {last.planned} of {last.total} of the plan" if last and last.total else ""
        click.echo(f"{out}: {last.held if last else 0} poses{of_plan}" if last else "no frame came from the cell")
