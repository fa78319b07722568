"""``cellwatt explain`` and ``cellwatt simulate``."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path

import click
from threadpoolctl import threadpool_limits

from cellwatt.commands.options import INPUT, FiniteRange, with_columns, with_progress, with_scheduler
from cellwatt.errors import ConfigError
from cellwatt.files import write_file
from cellwatt.progress import stage
from cellwatt.tables import write_table
from cellwatt_plugins.explain import api
from cellwatt_plugins.explain.input.sources import simulator_file
from cellwatt_plugins.explain.model import Prediction, save_model
from cellwatt_plugins.explain.report.terminal import in_words
from cellwatt_plugins.explain.simulators.mend import mend, to_mend
from cellwatt_plugins.explain.simulators.mend_drives import mend_driven
from cellwatt_plugins.explain.simulators.wording import mended_in_words
from cellwatt_plugins.robot.simulated import is_simulator
from cellwatt_plugins.robot_option import ROBOT

OUTPUT = click.Path(file_okay=False, writable=True, path_type=Path)
METER = "Power (t, power) logged by a meter on its own clock, one file per recording."


class _Explain(click.Command):
    """Accept several values after one ``--simulation``, up to the next option or a simulator's own file."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        spread: list[str] = []
        following = False
        for word in args:
            if word.startswith("-"):
                following = word == "--simulation"
                spread += [word]
            else:
                # The first value follows the option itself.
                spread += ["--simulation", word] if following and spread[-1] != "--simulation" else [word]
                following = following and not is_simulator(Path(word))
        if any(word == "--simulation" and after.startswith("-") for word, after in pairwise([*spread, "-"])):
            raise click.BadOptionUsage("--simulation", "Option '--simulation' requires an argument.", ctx)
        try:
            return super().parse_args(ctx, spread)
        except click.MissingParameter as error:
            if error.param is None or error.param.name != "recordings" or "--simulation" not in args:
                raise
            message = "Give the recordings before --simulation, which takes the files after it."
            raise click.UsageError(message, ctx) from error


@click.command(cls=_Explain, short_help="Name the physics that a simulation leaves out.")
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...", type=INPUT)
@click.option(
    "--simulation", "simulations", multiple=True, type=INPUT, help="Simulation of each recording, or a simulator file."
)
@click.option("--meter", "meters", multiple=True, type=INPUT, help=METER)
@click.option("--robot", type=ROBOT, help="robot.yaml, its folder, or a packaged robot; omitted: the simulator's file.")
@click.option("--out", required=True, type=OUTPUT, help="Folder to write.")
@click.option("--json", "as_json", is_flag=True, help="Print findings.json.")
@click.option(
    "--time",
    "seconds",
    type=FiniteRange(min=1.0),
    default=50.0,
    show_default=True,
    help="Seconds of CPU time (with --scheduler: elapsed time) after which the search stops.",
)
@click.option("--mend", "simulator", type=INPUT, help="MJCF or URDF to write to OUT with the findings added.")
@click.option("--no-report", is_flag=True, help="Leave out report.html.")
@with_progress
@with_scheduler
@with_columns
def explain(
    recordings: tuple[Path, ...],
    simulations: tuple[Path, ...],
    meters: tuple[Path, ...],
    robot: Path | None,
    out: Path,
    as_json: bool,
    seconds: float,
    simulator: Path | None,
    no_report: bool,
) -> None:
    """Report where RECORDINGs differ from the simulation, which physics it leaves out, and how much a model gains.

    Recordings and simulations are Parquet, CSV or cellwatt recordings. Several simulations may follow one --simulation.
    A simulator's own file (MJCF, URDF) may replace them: it is run on each recorded motion, and needs no robot.yaml.
    Without simulations, robot.yaml is simulated on the recorded motion. Writes findings.json, model.yaml and
    report.html.
    """
    given = simulations or ((simulator,) if simulator else ())
    arm = api.arm_of(robot, simulator_file(given) or simulator, recordings)
    user = None if simulator is None else to_mend(simulator, arm.body)
    found = api.explain(recordings, robot=robot or arm, simulation=given, meter=meters, seconds=seconds)
    content = found.as_json()
    write_file(out / "findings.json", json.dumps(content, indent=1))
    save_model(found.model, out / "model.yaml")
    mended, unmended = None, None
    if user is not None:
        driven = any(run.drive is not None for run in found.runs)
        with threadpool_limits(1), stage("mending the simulator's file"):
            try:
                mended = (mend_driven if driven else mend)(found, found.runs, user, out)
            except ConfigError as error:
                unmended = error  # the findings are reported all the same
    if not no_report:
        with stage("writing the report"):
            found.report(out / "report.html", None if mended is None else mended.path)
    if mended is not None:
        content["mended"] = mended.as_json()
        write_file(out / "findings.json", json.dumps(content, indent=1))
    click.echo(json.dumps(content) if as_json else in_words(found, out, report=not no_report))
    if mended is not None:
        click.echo(mended_in_words(mended), err=as_json)
    if unmended is not None:
        raise unmended


@click.command(short_help="Predict torque and power with a model of explain.")
@click.option("--model", required=True, type=INPUT, help="model.yaml of `cellwatt explain`, or its folder.")
@click.option("--motion", required=True, type=INPUT, help="Motion: t, q_i, qd_i, qdd_i (and temperature_i).")
@click.option("--simulation", type=INPUT, help="Output of the user's simulation for that motion; the model adds to it.")
@click.option("--out", required=True, type=click.Path(dir_okay=False, path_type=Path), help="Parquet file to write.")
@click.option("--json", "as_json", is_flag=True, help="Report as JSON.")
@with_progress
@with_columns
def simulate(model: Path, motion: Path, simulation: Path | None, out: Path, as_json: bool) -> None:
    """Write the torque and supply power that a model predicts for a motion as Parquet: t, tau_i, power.

    A motion with accelerations is treated as planned; one without as measured, and smoothed using the simulation.
    """
    predicted = api.simulate(model, motion, simulation)
    write_prediction(predicted, out)
    samples = len(predicted.time)
    report = {"file": str(out), "samples": samples, "joints": predicted.torque.shape[1]}
    click.echo(json.dumps(report) if as_json else f"written to {out}: {samples} samples")


def write_prediction(predicted: Prediction, path: Path) -> None:
    """Write t, tau_1 … tau_n and power as Parquet. Raises ``RecordingError``."""
    columns = {"t": predicted.time}
    columns |= {f"tau_{i + 1}": predicted.torque[:, i] for i in range(predicted.torque.shape[1])}
    write_table(path, {**columns, "power": predicted.power})
