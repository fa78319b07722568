"""``cellwatt energy-campaign``: the guided measurement whose files ``cellwatt disaggregate`` reads."""

from __future__ import annotations

import json
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cellwatt.commands.numbers import FiniteRange
from cellwatt.commands.quiet import with_progress
from cellwatt.errors import CellwattError, ConfigError, why
from cellwatt.progress import steps
from cellwatt_plugins.energy.procedure.cube import REPETITIONS, SPEEDS, load_cube
from cellwatt_plugins.energy.procedure.programs import minutes, programs

if TYPE_CHECKING:
    from cellwatt_plugins.energy.procedure.rest_pose import RestPose
    from cellwatt_plugins.robot import Arm

FILE = click.Path(exists=True, path_type=Path)
FOLDER = click.Path(file_okay=False, path_type=Path)
_robot = click.option("--robot", required=True, type=FILE, help="The robot's YAML description, or its folder.")
_json = click.option("--json", "as_json", is_flag=True, help="Report as JSON.")
_source = click.option("--source", help="The arm's source, where several have joints.")
_supply = click.option("--supply", help="The analyzer's source, where several have supply.power.")


def _speeds(context: click.Context, parameter: click.Parameter, value: str) -> tuple[float, ...]:
    try:
        speeds = tuple(float(word) for word in value.split(","))
    except ValueError as error:
        raise click.BadParameter("expected numbers like 50,100,150", context, parameter) from error
    if not all(0 < speed <= 2000 for speed in speeds):
        raise click.BadParameter("speeds are above 0 and up to 2000 mm/s", context, parameter)
    return speeds


_all = ",".join(f"{speed:g}" for speed in SPEEDS)
_speed = click.option(
    "--speeds", default=_all, show_default=True, callback=_speeds, help="mm/s, means of a repetition."
)
_count = click.option("--repetitions", default=REPETITIONS, show_default=True, type=click.IntRange(1), help="Each.")
_least = click.option(
    "--least", type=click.IntRange(1), help="Whole repetitions in a row that a run needs (default: all of them)."
)


@click.group("energy-campaign", short_help="Measure a robot's energy step by step.")
def campaign() -> None:
    """Measure where a robot's energy goes: step by step, with the power analyzer and the cell running.

    cellwatt only watches and records: the operator moves the arm and starts the programs.
    """


@campaign.command("rest-pose")
@_robot
@click.option("--starts", default=32, show_default=True, type=click.IntRange(1, 4096), help="Places to search from.")
@_json
@with_progress
def rest_pose(robot: Path, starts: int, as_json: bool) -> None:
    """Find the pose at which gravity asks the least of the motors: there the brakes' power is measured."""
    import numpy as np

    from cellwatt_plugins.energy.drive import MOTOR
    from cellwatt_plugins.robot import Arm

    found, place = _rest_pose(Arm.load(robot, MOTOR), starts)
    if as_json:
        click.echo(
            json.dumps(
                {
                    "joints": found.q.tolist(),
                    "torque": found.torque.tolist(),
                    "residual": found.residual,
                    "clearance": found.clearance,
                    "starts": found.starts,
                    "reached": found.reached,
                    "last_joint_at": list(place),
                }
            )
        )
        return
    degrees = ", ".join(f"{angle:.1f}" for angle in np.degrees(found.q))
    click.echo(
        f"joints at {degrees} deg\n"
        f"gravity leaves {found.residual:.3f} Nm in all; the least found from {found.starts} places, "
        f"as low from {found.reached} of them\n"
        f"the last joint is at {', '.join(f'{x:.2f}' for x in place)} m; {100 * found.clearance:.0f} cm to the nearest "
        "link or the floor. What else stands in the cell is not known here: look before you move"
    )


@campaign.command("programs")
@click.argument("name", metavar="ROBOT")
@click.option("--out", required=True, type=FOLDER, help="Folder to write.")
@_speed
@_count
@click.option("--cube", "file", type=FILE, help="YAML with cubes of other robots, of the form of the packaged ones.")
@_json
def write_programs(
    name: str, out: Path, speeds: tuple[float, ...], repetitions: int, file: Path | None, as_json: bool
) -> None:
    """Write the programs of the ISO 9283 cube for ROBOT (UR5e, UR10e, FR3, Gen3): one without, one with payload.

    URScript for the UR arms; for the others poses and times as JSON, for a program of your own.
    """
    cube = load_cube(name, file)
    texts = programs(name, cube, speeds, repetitions)
    try:
        out.mkdir(parents=True, exist_ok=True)
        for title, text in texts.items():
            (out / title).write_text(text)
    except OSError as error:
        raise CellwattError(f"{out}: cannot be written: {why(error)}") from error
    each = minutes(cube, speeds, repetitions)
    files = [str(out / title) for title in texts]
    if as_json:
        click.echo(json.dumps({"files": files, "minutes_each": each, "path_m": float(cube.legs.sum())}))
        return
    click.echo(f"written: {', '.join(files)}\n{each:.0f} min each, {cube.legs.sum():.2f} m a repetition")
    click.echo("Try each at low speed first: points are the paper's, your cell may have less room.")


@campaign.command("measure")
@click.argument("cell", type=FILE)
@_robot
@click.option("--out", required=True, type=FOLDER, help="Folder of the campaign; the same one goes on.")
@_speed
@_count
@_least
@click.option("--again", multiple=True, help="Repeat a step: controller, connected, released, 0kg, …")
@click.option("--seconds", default=60.0, show_default=True, type=FiniteRange(2), help="Length of a reading.")
@click.option("--patience", default=900.0, show_default=True, type=FiniteRange(2), help="s to wait for steadiness.")
@_source
@_supply
def measure(
    cell: Path,
    robot: Path,
    out: Path,
    speeds: tuple[float, ...],
    repetitions: int,
    least: int | None,
    again: tuple[str, ...],
    seconds: float,
    patience: float,
    source: str | None,
    supply: str | None,
) -> None:
    """Go through a campaign on the running cell CELL (its settings file) and write what `disaggregate` reads."""
    from cellwatt_plugins.energy.drive import MOTOR
    from cellwatt_plugins.energy.procedure.guide import Places, Plan, guide
    from cellwatt_plugins.energy.procedure.live import cell_of
    from cellwatt_plugins.energy.procedure.log import STATES
    from cellwatt_plugins.energy.procedure.recorded import Recorded
    from cellwatt_plugins.robot import Arm

    arm = Arm.load(robot, MOTOR)
    if not arm.description.payload > 0:
        raise ConfigError(f"{robot}: payload: write the maximum payload's mass, kg")
    running = cell_of(cell)
    pose, _ = _rest_pose(arm, 32)
    plan = Plan(arm, pose, speeds, repetitions, least or repetitions, seconds, patience)
    opened = partial(Recorded, running.record, arm, source, supply)
    guide(plan, Places(lambda: running.feed(supply, source), opened, out), _Click(), again)
    states = [name for name in STATES if (out / f"{name}.parquet").exists()]
    files = " ".join(f"--{name} {out / name}.parquet" for name in states)
    click.echo("\nAll is measured. Next:")
    click.echo(f"cellwatt disaggregate --robot {robot} {files} --runs {out / 'runs'} --out {out / 'report'}")


@campaign.command("cut")
@click.argument("recording", type=FILE)
@_robot
@click.option("--campaign", "log_file", required=True, type=FILE, help="campaign.json, which says what was when.")
@click.option("--out", required=True, type=FOLDER, help="Folder to write.")
@_speed
@_count
@_least
@_source
@_supply
@_json
@with_progress
def cut(
    recording: Path,
    robot: Path,
    log_file: Path,
    out: Path,
    speeds: tuple[float, ...],
    repetitions: int,
    least: int | None,
    source: str | None,
    supply: str | None,
    as_json: bool,
) -> None:
    """Cut the files of a campaign from RECORDING (a file or folder) once more, e.g. with fewer repetitions."""
    from cellwatt_plugins.energy.drive import MOTOR
    from cellwatt_plugins.energy.procedure.cut import cut_programme, cut_states, report
    from cellwatt_plugins.energy.procedure.log import read_log
    from cellwatt_plugins.energy.procedure.recorded import Recorded
    from cellwatt_plugins.robot import Arm

    arm, log = Arm.load(robot, MOTOR), read_log(log_file)
    recorded = Recorded(recording, arm, source, supply)
    states = cut_states(recorded, log, out)
    runs = [
        run
        for programme in steps(log.programmes, "cutting programme")
        for run in cut_programme(recorded, arm, programme, speeds, repetitions, least or repetitions, out)
    ]
    if as_json:
        click.echo(json.dumps(report(runs, states)))
    else:
        click.echo("\n".join([f"at rest: {', '.join(states) or 'nothing'}", *(run.in_words() for run in runs)]))


def _rest_pose(arm: Arm, starts: int) -> tuple[RestPose, tuple[float, ...]]:
    import numpy as np
    from threadpoolctl import threadpool_limits

    from cellwatt_plugins.energy.procedure.rest_pose import rest_pose as least_gravity
    from cellwatt_plugins.robot.collision import Checker

    # A whole turn either way says it all; further out poses only come again.
    limits = np.clip(arm.finite_limits(), -np.pi, np.pi)
    with threadpool_limits(1):
        found = least_gravity(arm, limits, Checker(arm, limits), starts)
    place = arm.forward(found.q[None])[0, -1, :3, 3]
    return found, tuple(place.tolist())


@dataclass
class _Click:
    """The operator's terminal."""

    _shown: bool = False

    def say(self, text: str) -> None:
        """See ``Terminal.say``."""
        click.echo(f"\n{text}" if self._shown else text)
        self._shown = False

    def show(self, text: str) -> None:
        """See ``Terminal.show``; nothing where the output is kept in a file."""
        if sys.stdout.isatty():
            click.echo(f"\r{text:<70s}", nl=False)
            self._shown = True

    def ask(self, question: str, answers: str) -> str:
        """See ``Terminal.ask``."""
        choice = click.Choice(list(answers), case_sensitive=False)
        given: str = click.prompt(question, type=choice, default=answers[0], show_choices=False, show_default=False)
        return given
