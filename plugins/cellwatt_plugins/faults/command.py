"""``cellwatt reference``: learn what healthy running looks like."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
import numpy as np

from cellwatt.errors import ConfigError, ModelError, RecordingError, why
from cellwatt.frames import Frames
from cellwatt.registry import stage as find_stage
from cellwatt.results import Interval, Result, Task
from cellwatt.stage import CellInfo
from cellwatt.yaml_file import read_yaml
from cellwatt_plugins.faults.cycles.recording import Recording, recording_of
from cellwatt_plugins.faults.learn import Cell, learn
from cellwatt_plugins.faults.recordings import frames_of_files
from cellwatt_plugins.faults.reference import Reference, load, save
from cellwatt_plugins.faults.trace import Trace
from cellwatt_plugins.faults.train_command import train

if TYPE_CHECKING:
    from cellwatt_plugins.faults.cycles.findings import CycleFinding

FILE = click.Path(exists=True, path_type=Path)
JUDGE = "judge"
"""Subcommand of `cellwatt faults` where none is named."""
METER = "Power (t, power) that a meter logged on its own clock, one a table."


@click.command()
@click.argument(
    "recordings", nargs=-1, required=True, metavar="RECORDING...", type=click.Path(exists=True, path_type=Path)
)
@click.option("--out", required=True, type=click.Path(dir_okay=False, path_type=Path), help="Reference file to write.")
@click.option("--robot", help="Name of the robot, or its YAML description (or its folder).")
@click.option("--meter", "meters", multiple=True, type=FILE, help=METER)
@click.option("--arm", help="Source with the joints, where several have joints.")
@click.option("--power", default="supply.power", show_default=True, help="Channel of the power.")
@click.option("--json", "as_json", is_flag=True, help="Report as JSON.")
def reference(
    recordings: tuple[Path, ...],
    out: Path,
    robot: str | None,
    meters: tuple[Path, ...],
    arm: str | None,
    power: str,
    as_json: bool,
) -> None:
    """Learn the healthy reference from RECORDINGs of healthy running.

    Recordings are cellwatt's own (.mcap, or their folder) or tables (.parquet, .csv) with columns t (s),
    q_1 … q_n (rad) and power (W). Each task must be seen three times or more at each speed.
    """
    name = _robot_name(robot)
    blocks = list(frames_of_files(recordings, meters))
    if robot is not None and _described(robot):
        learned, tasks = _learned_with_cycles(blocks, Path(robot), arm, power)
    else:
        learned, tasks = learn_from(blocks, name, arm, power)
    save(learned, out)
    report = _report(learned, tasks, out)
    click.echo(json.dumps(report) if as_json else _in_words(report))


class _Faults(click.Group):
    """`cellwatt faults RECORDING...` judges; a word that is a command of this group is that command."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in {*self.commands, *ctx.help_option_names}:
            args = [JUDGE, *args]
        return super().parse_args(ctx, args)


@click.group(cls=_Faults)
def faults() -> None:
    """Judge cycles (`cellwatt faults RECORDING... --reference FILE`), or train networks that do (`faults train`)."""


@faults.command(JUDGE)
@click.argument(
    "recordings", nargs=-1, required=True, metavar="RECORDING...", type=click.Path(exists=True, path_type=Path)
)
@click.option("--reference", "file", required=True, type=FILE, help="File made by `cellwatt reference`.")
@click.option("--robot", type=FILE, help="The robot's YAML description, or the folder that holds it.")
@click.option(
    "--network", type=FILE, help="Network of a motion, or the folder of several: it judges in place of --robot."
)
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help="findings.json to write.")
@click.option("--meter", "meters", multiple=True, type=FILE, help=METER)
@click.option("--arm", help="Source with the joints, where several have joints; as in the reference where left out.")
@click.option("--power", help="Channel of the power; as in the reference where left out.")
@click.option(
    "--false-alarms",
    type=click.FloatRange(0.0, 0.1, min_open=True),
    default=1e-4,
    show_default=True,
    help="Share of healthy intervals in which a false alarm is accepted.",
)
@click.option("--json", "as_json", is_flag=True, help="Print findings.json.")
def judge(
    recordings: tuple[Path, ...],
    file: Path,
    robot: Path | None,
    network: Path | None,
    out: Path | None,
    meters: tuple[Path, ...],
    arm: str | None,
    power: str | None,
    false_alarms: float,
    as_json: bool,
) -> None:
    """Judge every cycle of RECORDINGs against healthy ones: what is harmless, and which joint or encoder is faulty.

    RECORDINGs as for `cellwatt reference`, which must have been given the same description of the robot.
    """
    if (robot is None) == (network is None):
        raise ConfigError("give one of --robot and --network: what cycles are judged by")
    learnt = load(file)
    blocks = list(frames_of_files(recordings, meters))
    recording = recording_of(blocks, arm, power or learnt.power)
    if recording.joints != learnt.joints:
        raise RecordingError(f"the recording has {recording.joints} joints, reference {file} {learnt.joints}")
    if robot is not None:
        found = _judged(recording, learnt, file, robot, false_alarms)
    else:
        assert network is not None
        found = _judged_by_network(recording, learnt, file, network)
    content = {"cycles": [asdict(finding) for finding in found]}
    if out is not None:
        try:
            out.write_text(json.dumps(content, indent=1))
        except OSError as error:
            raise RecordingError(f"--out {out}: cannot be written: {why(error)}") from error
    click.echo(json.dumps(content) if as_json else _findings_in_words(found, out))


faults.add_command(train)


def _judged(
    recording: Recording, reference: Reference, file: Path, robot: Path, false_alarms: float
) -> list[CycleFinding]:
    """Findings by the physics of the arm. Raises ``CellwattError``."""
    from cellwatt_plugins.faults.cycles.findings import judge_recording
    from cellwatt_plugins.faults.cycles.watch import known_of

    return judge_recording(recording, known_of(reference, file, robot, false_alarms))


def _judged_by_network(recording: Recording, reference: Reference, file: Path, network: Path) -> list[CycleFinding]:
    """Findings by the networks of motions, as live. Raises ``CellwattError``."""
    from cellwatt_plugins.faults.cycles.live import CycleWatch
    from cellwatt_plugins.faults.paper.networks import networks_of

    judge = networks_of(network, reference, file).motions
    if judge is None:
        raise ModelError(f"--network {network}: has codes only; whole cycles need the network of a motion")
    watch = CycleWatch(judge, recording.step)
    told = [*watch.feed(recording.time, recording.position, recording.power), *watch.close()]
    return [each.finding for each in told if each.over]


def _learned_with_cycles(
    blocks: Sequence[Frames], robot: Path, arm: str | None, power: str
) -> tuple[Reference, list[Task]]:
    """The reference with whole cycles and the arm that their power shows; intervals where they recur often enough."""
    from cellwatt_plugins.faults.cycles.known import learn_known, stored
    from cellwatt_plugins.robot import load_robot

    description = load_robot(robot)
    model, cycles = stored(learn_known(recording_of(blocks, arm, power), description), description)
    tasks: list[Task] = []
    try:
        learned, tasks = learn_from(blocks, description.robot, arm, power)
    except ModelError as error:
        click.echo(f"whole cycles only, no intervals: {error}", err=True)
        layout = blocks[0].layout
        source = layout.channels[layout.joints("position", arm)[0]].source
        learned = Reference(1, description.robot, source, power, len(description.joints), ())
    return replace(learned, power_model=model, cycles=cycles), tasks


def _description(robot: str | None) -> Path | None:
    """The file of a description, or of the folder that holds it; None where it is only a name."""
    if robot is None:
        return None
    if Path(robot).is_dir():
        return Path(robot) / "robot.yaml"
    return Path(robot) if robot.endswith((".yaml", ".yml")) else None


def _described(robot: str) -> bool:
    """True if a YAML description states enough of the arm to model it."""
    file = _description(robot)
    content = _content(robot, file) if file is not None else None
    return isinstance(content, dict) and "urdf" in content and "joints" in content


def _findings_in_words(found: Sequence[CycleFinding], out: Path | None) -> str:
    lines = []
    for cycle in found:
        speed = "" if cycle.speed is None else f" at speed {cycle.speed:.2f}"
        note = f": {cycle.note}" if cycle.note else ""
        lines.append(f"{cycle.start:9.2f} … {cycle.end:.2f} s  {cycle.task}{speed}  {cycle.status}{note}")
        lines += [f"{'':12}{fault.statement}" for fault in cycle.faults]
    count = Counter(cycle.status for cycle in found)
    lines.append(f"{len(found)} cycles: " + ", ".join(f"{n} {status}" for status, n in sorted(count.items())))
    return "\n".join([*lines, f"written to {out}"] if out else lines)


def learn_from(
    blocks: Iterable[Frames], robot: str | None, arm: str | None, power: str
) -> tuple[Reference, list[Task]]:
    """The reference of some frames, and every task seen in them. Raises ``CellwattError``."""
    parts: list[Trace] = []
    found: list[Result] = []
    segment: Any = None
    columns: list[int] = []
    channel = 0
    for frames in blocks:
        if segment is None:
            segment_class = find_stage("segment")
            cell = CellInfo("", "", robot, Path())
            segment = segment_class("segment", segment_class.Settings.model_validate({"arm": arm}), frames.layout, cell)
            columns, channel = list(frames.layout.joints("position", arm)), frames.layout.index(power)
        elif frames.layout != segment.layout:
            raise RecordingError("the channels or the rate of the frames change from one recording to the next")
        parts.append(Trace(frames.time, frames.values[:, columns], frames.values[:, channel]))
        found.extend(segment.process(frames, ()))
    if segment is None:
        raise RecordingError("no frames in these recordings")
    found.extend(segment.close())
    layout = segment.layout
    source = layout.channels[columns[0]].source
    head = Cell(robot, source, power, layout.step * 1e-9)
    tasks = [r for r in found if isinstance(r, Task)]
    trace = Trace(*(np.concatenate([getattr(p, name) for p in parts]) for name in ("time", "position", "power")))
    return learn(head, trace, [r for r in found if isinstance(r, Interval)], tasks), tasks


def _robot_name(robot: str | None) -> str | None:
    """The name itself, or what a YAML description gives under ``robot``. Raises ``ConfigError``."""
    file = _description(robot)
    if file is None:
        return robot
    content = _content(robot, file)
    name = content.get("robot") if isinstance(content, dict) else None
    if not isinstance(name, str):
        raise ConfigError(f"--robot {robot}: has no key robot with a name")
    return name


def _content(robot: str | None, file: Path) -> Any:
    try:
        return read_yaml(file)
    except (OSError, ValueError) as error:
        raise ConfigError(f"--robot {robot}: cannot be read: {str(error).splitlines()[0]}") from error


def _report(learned: Reference, tasks: list[Task], out: Path) -> dict[str, Any]:
    cycles = sum(v.cycles for t in learned.tasks for v in t.variants)
    return {
        "file": str(out),
        "robot": learned.robot,
        "tasks": [
            {
                "name": task.name,
                "signature": task.signature,
                "variants": [
                    {"speed": v.speed, "cycles": v.cycles, "intervals": len(v.intervals)} for v in task.variants
                ],
            }
            for task in learned.tasks
        ],
        "cycles_left_out": len(tasks) - cycles,
    }


def _in_words(report: dict[str, Any]) -> str:
    lines = []
    for task in report["tasks"]:
        variants = ", ".join(f"{v['cycles']} cycles at speed {v['speed']:.2f}" for v in task["variants"])
        lines.append(f"{task['name']}: {task['variants'][0]['intervals']} moves, {variants}")
    if report["cycles_left_out"]:
        lines.append(f"{report['cycles_left_out']} cycles left out: seen too rarely at their speed")
    return "\n".join([*lines, f"written to {report['file']}"])
