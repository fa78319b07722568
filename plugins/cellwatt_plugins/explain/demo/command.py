"""``cellwatt demo explain``."""

from __future__ import annotations

import io
import json
import secrets
import shlex
import sys
from collections.abc import Sequence
from contextlib import nullcontext, redirect_stdout
from pathlib import Path

import click
import numpy as np

from cellwatt.commands import EXIT_FAILED
from cellwatt.errors import ConfigError
from cellwatt.files import make_folder
from cellwatt_plugins.explain.command import explain
from cellwatt_plugins.explain.demo.arm import JOINTS, believed, draw, mjcf
from cellwatt_plugins.explain.demo.physics import Concealed, by_chance, conceal, kinds
from cellwatt_plugins.explain.demo.plant import Log, motions, run
from cellwatt_plugins.explain.demo.reveal import Revealed, compared, in_words

NOTHING = "nothing"
COLUMNS = ("qpos", "qvel", "actuator_force")
"""MuJoCo's names of the logged quantities."""


@click.command()
@click.option(
    "--conceal",
    "wanted",
    multiple=True,
    type=click.Choice([*kinds(), NOTHING]),
    help="Physics to conceal; may be repeated. Default: one or two kinds by chance.",
)
@click.option("--seed", type=click.IntRange(min=0), help="Seed of the random draw of the arm and its physics.")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), help="Folder to write: demo-explain-SEED.")
@click.option("--only-files", is_flag=True, help="Write the files and print the physics, without running explain.")
@click.option("--json", "as_json", is_flag=True, help="Print the truth beside the findings, as JSON.")
def command(wanted: tuple[str, ...], seed: int | None, out: Path | None, only_files: bool, as_json: bool) -> None:
    """Conceal physics from a simulation, and let `explain` find it.

    An arm is drawn at random, with physics that the user's simulation (arm.xml) lacks. MuJoCo runs the arm under a
    controller, and its sensors make the recordings. `cellwatt explain` gets these files and nothing else, as it would
    get yours. The concealed physics is shown after its answer. The files stay in the folder.

    Exit code 1 if explain is wrong.
    """
    seed = secrets.randbelow(10_000) if seed is None else seed
    folder = Path(f"demo-explain-{seed}") if out is None else out
    echo = (lambda _: None) if as_json else click.echo
    concealed = write_files(folder, wanted, np.random.default_rng(seed))
    if only_files:
        click.echo("\n".join(each.sentence + "." for each in concealed) or "Nothing is concealed.")
        return
    words = ["run_1.csv", "run_2.csv", "--simulation", "arm.xml", "--mend", "arm.xml", "--out", "result"]
    echo(f"{folder}: arm.xml is your simulation, run_1.csv and run_2.csv are what the arm's sensors measured")
    echo(f"$ cd {shlex.quote(str(folder))} && cellwatt explain {shlex.join(words)}\n")
    revealed = _explained(folder, concealed, as_json)
    if as_json:
        click.echo((folder / "revealed.json").read_text())
    else:
        outcome = ("names it, but a number is further off than its ± allows", "is right")[revealed.exact]
        again = shlex.join(["cellwatt", "demo", "explain", *(f"--conceal={name}" for name in wanted), f"--seed={seed}"])
        click.echo(f"\n{in_words(revealed)}\n\nexplain {outcome if revealed.right else 'is wrong here'}.")
        click.echo(f"to repeat it: {again}\nthe report: {(folder / 'result' / 'report.html').resolve()}")
    if not revealed.right:
        sys.exit(EXIT_FAILED)


def write_files(folder: Path, wanted: Sequence[str], rng: np.random.Generator) -> list[Concealed]:
    """Write the user's simulation and the recordings into ``folder``; return what was concealed."""
    make_folder(folder)
    arm = draw(rng)
    (folder / "arm.xml").write_text(mjcf(believed(arm, rng)))
    names = [name for name in dict.fromkeys(wanted or by_chance(rng)) if name != NOTHING]
    concealed = conceal(names, rng, arm)
    for number, motion in enumerate(motions(rng), start=1):
        _write(folder / f"run_{number}.csv", run(arm, folder / "arm.xml", concealed, motion, rng))
    return concealed


def _write(path: Path, log: Log) -> None:
    names = ["time", *(f"{name}{joint}" for name in COLUMNS for joint in range(JOINTS))]
    values = np.column_stack([log.time, log.position, log.velocity, log.torque])
    np.savetxt(path, values, "%.7g", ",", header=",".join(names), comments="")


def _explained(folder: Path, concealed: Sequence[Concealed], as_json: bool) -> Revealed:
    """Run ``cellwatt explain`` as a user would, and compare its answer with the concealed physics."""
    result = folder / "result"
    files = [str(folder / name) for name in ("run_1.csv", "run_2.csv")]
    simulation = str(folder / "arm.xml")
    words = [*files, "--simulation", simulation, "--mend", simulation, "--out", str(result)]
    with redirect_stdout(io.StringIO()) if as_json else nullcontext():
        try:
            explain.main([*words, *(["--quiet"] if as_json else [])], standalone_mode=False)
        except ConfigError as error:  # of --mend, after the answer
            click.echo(str(error), err=True)
    findings = json.loads((result / "findings.json").read_text())
    revealed = compared(concealed, findings)
    (folder / "revealed.json").write_text(json.dumps(revealed.as_json(), indent=1))
    return revealed
