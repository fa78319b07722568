"""``cellwatt energy-campaign``: prepares a measurement and writes the files that ``cellwatt disaggregate`` reads."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import click

from cellwatt.commands.options import FiniteRange, with_progress
from cellwatt_plugins.robot_option import with_robot

FILE = click.Path(exists=True, path_type=Path)
FOLDER = click.Path(file_okay=False, path_type=Path)
_json = click.option("--json", "as_json", is_flag=True, help="Report as JSON.")
SPEEDS = (50, 100, 150, 200, 250)
"""Speeds of the paper, mm/s, means over a repetition."""
REPETITIONS = 30
"""Repetitions of each test recommended by ISO 9283."""
STATES = ("controller", "connected", "released")
KNOWN = 0.05
"""Largest standard deviation of a mean power that is accepted without a warning, W."""


def _speeds(context: click.Context, parameter: click.Parameter, value: str) -> tuple[float, ...]:
    try:
        speeds = tuple(float(word) for word in value.split(","))
    except ValueError as error:
        raise click.BadParameter("expected numbers like 50,100,150", context, parameter) from error
    if not all(0 < speed <= 2000 for speed in speeds):
        raise click.BadParameter("speeds are above 0 and up to 2000 mm/s", context, parameter)
    return speeds


@click.group("energy-campaign", short_help="Measure a robot's energy step by step.")
def campaign() -> None:
    """Prepare the measurement of a robot's energy by consumer, and cut its files from recordings.

    cellwatt only records: the operator moves the arm and starts the programs.
    """


@campaign.command("rest-pose")
@with_robot
@click.option("--starts", default=32, show_default=True, type=click.IntRange(1, 4096), help="Number of start poses.")
@_json
@with_progress
def rest_pose(robot: Path, starts: int, as_json: bool) -> None:
    """Find the pose of least gravity torque, at which the brakes' power is measured."""
    import numpy as np
    from threadpoolctl import threadpool_limits

    from cellwatt_plugins.energy.drive import MOTOR
    from cellwatt_plugins.energy.procedure.rest_pose import rest_pose as least_gravity
    from cellwatt_plugins.robot import Arm

    arm = Arm.load(robot, MOTOR)
    with threadpool_limits(1):
        found = least_gravity(arm, starts)
    last = arm.forward(found.q[None])[0, -1, :3, 3].tolist()
    if as_json:
        about = asdict(found) | {"joints": found.q.tolist(), "torque": found.torque.tolist()}
        del about["q"]
        click.echo(json.dumps({**about, "residual": found.residual, "last_joint_at": last}))
        return
    degrees = ", ".join(f"{angle:.1f}" for angle in np.degrees(found.q))
    click.echo(
        f"joints at {degrees} deg\n"
        f"gravity torque {found.residual:.3f} Nm in total, the smallest found from {found.starts} start poses; "
        f"{found.reached} of them led to it\n"
        f"the last joint is at {', '.join(f'{x:.2f}' for x in last)} m; {100 * found.clearance:.0f} cm to the nearest "
        "link or the floor. Other objects in the cell are not known: check before you move"
    )


@campaign.command("cut")
@click.argument("recording", type=FILE)
@with_robot
@click.option("--state", type=click.Choice(STATES), help="RECORDING holds the power at rest in this state.")
@click.option("--payload", type=FiniteRange(0), help="RECORDING holds a program with this payload, kg.")
@click.option("--out", required=True, type=FOLDER, help="Folder of the campaign.")
@click.option(
    "--speeds",
    default=",".join(map(str, SPEEDS)),
    show_default=True,
    callback=_speeds,
    help="Mean speeds of a repetition, mm/s.",
)
@click.option("--repetitions", default=REPETITIONS, show_default=True, type=click.IntRange(1), help="Per speed.")
@click.option(
    "--least", type=click.IntRange(1), help="Whole repetitions in a row that a run needs (default: all of them)."
)
@click.option("--source", help="The arm's source, if several have joints.")
@click.option("--supply", help="The analyzer's source, if several have supply.power.")
@_json
@with_progress
def cut(
    recording: Path, robot: Path, state: str | None, payload: float | None, out: Path, as_json: bool, **asked: Any
) -> None:
    """Cut the files that `disaggregate` reads from RECORDING (a file or folder of the cell).

    With --state, RECORDING holds the power of the robot at rest; with --payload, the runs of a program, one per speed.
    """
    from cellwatt.record import Recording
    from cellwatt_plugins.energy.drive import MOTOR
    from cellwatt_plugins.energy.procedure.cut import cut_programme, cut_state
    from cellwatt_plugins.energy.procedure.recorded import motion_of, power_of
    from cellwatt_plugins.robot import Arm

    if (state is None) == (payload is None):
        raise click.UsageError("expected either --state or --payload, which says what the recording holds")
    opened, source = Recording.open(recording), asked.pop("source")
    reading = power_of(opened, asked.pop("supply"))
    if payload is not None:
        arm = Arm.load(robot, MOTOR)
        runs = cut_programme(arm, motion_of(opened, arm, source), reading, payload, out=out, **asked)
        click.echo(json.dumps([asdict(run) for run in runs]) if as_json else "\n".join(r.in_words() for r in runs))
        return
    found = cut_state(reading, out / f"{state}.parquet")
    words = f"{state}: {found.power:.2f} ± {found.uncertainty:.3f} W, drift {found.drift:+.2f} W"
    click.echo(json.dumps(asdict(found)) if as_json else words)
    if not found.steady:
        click.echo("not steady: let it warm up, and record it again", err=True)
    elif found.uncertainty > KNOWN:
        click.echo("the mean is uncertain: a load switches; find it", err=True)
