"""``cellwatt faults train``: trains networks for an arm's tasks from its reference and cycles with known faults."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import click
import numpy as np

from cellwatt.commands.options import INPUT, with_columns, with_progress, with_scheduler
from cellwatt.errors import ConfigError, ModelError
from cellwatt.files import write_file
from cellwatt.scheduler import spread
from cellwatt_plugins.faults.criteria import Codes, Tolerance
from cellwatt_plugins.faults.paper.columns import recorded
from cellwatt_plugins.faults.paper.course import Key, courses_of
from cellwatt_plugins.faults.paper.training import Sources, train_codes
from cellwatt_plugins.faults.recordings import frames_of_files
from cellwatt_plugins.faults.reference import load
from cellwatt_plugins.faults.trace import one_layout
from cellwatt_plugins.robot.meter.file import with_meters
from cellwatt_plugins.robot_option import ROBOT

_Files = tuple[Path, Path | None]
"""A recording and the table of its meter, None if the recording holds its own power."""


@click.command("train")
@click.argument("recordings", nargs=-1, metavar="[RECORDING...]", type=INPUT)
@click.option("--reference", "file", required=True, type=INPUT, help="File made by `cellwatt reference`.")
@click.option("--out", required=True, type=click.Path(file_okay=False, path_type=Path), help="Folder to write to.")
@click.option("--fault", "faulty", multiple=True, metavar="JOINT=RECORDING", help="A fault of a joint, recorded.")
@click.option("--robot", type=ROBOT, help="The robot's description, to simulate faults that were not recorded.")
@click.option(
    "--meter", multiple=True, type=INPUT, help="As for `cellwatt reference`: of each RECORDING, then --fault."
)
@click.option("--arm", help="Source with the joints; default: that of the reference.")
@click.option("--power", help="Channel of the power; default: that of the reference.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Start of the random numbers.")
@click.option("--json", "as_json", is_flag=True, help="Report as JSON.")
@with_columns
@with_progress
@with_scheduler
def train(
    recordings: tuple[Path, ...],
    file: Path,
    out: Path,
    faulty: tuple[str, ...],
    robot: Path | None,
    meter: tuple[Path, ...],
    arm: str | None,
    power: str | None,
    seed: int,
    as_json: bool,
) -> None:
    """Train networks that name the faulty joint, one file for each task and speed of the reference.

    The network of the paper maps the code of each interval (power above, within or below its tolerance) to the joint.
    It is trained on a table learned from cycles with a fault of each joint: recorded cycles (--fault, once or more per
    joint), or else cycles simulated with a spring on the joint of the arm that --robot describes.

    The false alarms on RECORDINGs of a healthy robot are counted.
    """
    reference = load(file)
    courses, tolerance = courses_of(reference), Tolerance()
    if not courses:
        raise ModelError("the reference has whole cycles only, and no intervals, which a fault table needs")

    fitted = None
    if robot is not None:
        from cellwatt_plugins.faults.cycles.known import known_of

        fitted = known_of(reference, file, robot).arm
    slides = np.flatnonzero(fitted.body.levers != 1.0).tolist() if fitted else ()

    def codes_in(files: Sequence[_Files]) -> dict[Key, list[Codes]]:
        paths, meters = zip(*files, strict=True)
        beside = [each for each in meters if each is not None]
        blocks = list(frames_of_files(paths, beside, reference.names, slides))
        return recorded(blocks, courses, tolerance, reference.source(one_layout(blocks), arm), power or reference.power)

    known = _by_joint(faulty, reference.joints)
    files = with_meters([*recordings, *(path for _, path in known)], meter)
    healthy, of_faults = files[: len(recordings)], files[len(recordings) :]
    faulty_codes = {}
    for joint in dict.fromkeys(joint for joint, _ in known):
        faulty_codes[joint] = codes_in([each for (j, _), each in zip(known, of_faults, strict=True) if j == joint])
        if not faulty_codes[joint]:
            raise ModelError(f"--fault {joint}: no whole cycle of a task of the reference in these recordings")
    sources = Sources(faulty_codes, fitted, codes_in(healthy) if healthy else {}, tolerance, seed)
    report = []
    for about, content in spread(train_codes, courses, "networks of codes", shared=sources):
        if content is not None:
            about["file"] = str(out / f"{about['task']}-{about['speed']:g}-codes.onnx")
            write_file(Path(about["file"]), content)
        report.append(about)
    click.echo(json.dumps({"networks": report}) if as_json else "\n".join(map(_in_words, report)))


def _by_joint(faulty: Sequence[str], joints: int) -> list[tuple[int, Path]]:
    """Each faulty joint (1-based) with a recording. Raises ``ConfigError``."""
    out = []
    for given in faulty:
        joint, _, name = given.partition("=")
        if not joint.isdecimal() or not 1 <= int(joint) <= joints or not name:
            raise ConfigError(f"--fault {given}: expected JOINT=RECORDING with a joint from 1 to {joints}")
        if not Path(name).exists():
            raise ConfigError(f"--fault {given}: there is no {name}")
        out.append((int(joint), Path(name)))
    return out


def _in_words(network: Mapping[str, Any]) -> str:
    where = network["file"] or "no network of codes, as no fault moves the power beyond its tolerance"
    lines = [f"{where}: {network['task']} at speed {network['speed']:.2f}"]
    rows = zip(*network["table"], strict=True)
    for joint, (column, codes) in enumerate(zip(network["columns"], rows, strict=True), start=1):
        shown = " ".join(f"{code:+d}" if code else " 0" for code in codes)
        count = column["cycles"]
        origin = "at rest" if column["origin"] == "at rest" else f"{count} {column['origin']} cycle{'s' * (count > 1)}"
        lines.append(f"  joint {joint}: {shown}   {origin}")
    groups = [", ".join(map(str, group)) for group in network["named_together"]]
    lines += [f"  joints {group} have the same codes and are named together" for group in groups]
    if network["healthy_cycles"]:
        lines.append(f"  {network['named_in_vain']} of {network['healthy_cycles']} healthy cycles raise a false alarm")
    return "\n".join(lines)
