"""``cellwatt train power``."""

from __future__ import annotations

import json
from pathlib import Path

import click

FILE = click.Path(exists=True, path_type=Path)


@click.command("power")
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...", type=FILE)
@click.option("--robot", required=True, type=FILE, help="The robot's YAML description, or the folder that holds it.")
@click.option(
    "--meter", "meters", multiple=True, type=FILE, help="Power (t, power) of a meter's own clock, one a recording."
)
@click.option("--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder for the model.")
@click.option("--seed", default=0, show_default=True, help="Of the networks' first weights.")
@click.option("--json", "as_json", is_flag=True, help="Report as JSON.")
def train_power(
    recordings: tuple[Path, ...], robot: Path, meters: tuple[Path, ...], out: Path, seed: int, as_json: bool
) -> None:
    """Make a model of the currents and the supply power of a moving arm, from RECORDINGs of its moves.

    RECORDINGs are tables (Parquet, CSV) with t, q_i, qd_i, current_i and power, and move where a file holds several;
    or recordings of cellwatt. Prints how the paper's two methods and the best model do on moves that they have not
    seen, and writes model.onnx (the best model), nls.onnx and scg.onnx (the paper's) and power.json.
    """
    from threadpoolctl import threadpool_limits

    from cellwatt_plugins.models.power.exported import write, write_published
    from cellwatt_plugins.models.power.moves import read_moves
    from cellwatt_plugins.models.power.training import train
    from cellwatt_plugins.models.power.wording import as_json as report_of
    from cellwatt_plugins.models.power.wording import in_words
    from cellwatt_plugins.models.progress import progress_bar
    from cellwatt_plugins.robot import RigidBody, load_robot

    description = load_robot(robot)
    body = RigidBody(description.urdf, tuple(joint.name for joint in description.joints))
    moves = read_moves(recordings, body.joints, meters)
    with threadpool_limits(1), progress_bar(1.0, quiet=as_json) as advance:
        trained = train(moves, description, body, seed, advance)
    write(out / "model.onnx", trained.fitted, moves, body, description.robot)
    published = {"nls.onnx": trained.nls, "scg.onnx": trained.scg}
    for name, model in published.items():
        if model is not None:
            write_published(out / name, model, trained.tuning, moves, body, description.robot)
    report = json.dumps(report_of(trained, moves))
    (out / "power.json").write_text(report)
    written = ("model.onnx", *(name for name, model in published.items() if model is not None), "power.json")
    files = [str(out / name) for name in written]
    click.echo(report if as_json else in_words(trained, moves, files))
