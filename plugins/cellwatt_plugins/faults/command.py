"""``cellwatt reference``: learn what healthy running looks like."""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import click
import numpy as np
import yaml

from cellwatt.errors import ConfigError, RecordingError
from cellwatt.frames import Frames
from cellwatt.registry import stage as find_stage
from cellwatt.results import Interval, Result, Task
from cellwatt.stage import CellInfo
from cellwatt_plugins.faults.learn import Cell, learn
from cellwatt_plugins.faults.recordings import frames_of_files
from cellwatt_plugins.faults.reference import Reference, save
from cellwatt_plugins.faults.trace import Trace


@click.command()
@click.argument(
    "recordings", nargs=-1, required=True, metavar="RECORDING...", type=click.Path(exists=True, path_type=Path)
)
@click.option("--out", required=True, type=click.Path(dir_okay=False, path_type=Path), help="Reference file to write.")
@click.option("--robot", help="Name of the robot, or its YAML description.")
@click.option("--arm", help="Source with the joints, where several have joints.")
@click.option("--power", default="supply.power", show_default=True, help="Channel of the power.")
@click.option("--json", "as_json", is_flag=True, help="Report as JSON.")
def reference(
    recordings: tuple[Path, ...], out: Path, robot: str | None, arm: str | None, power: str, as_json: bool
) -> None:
    """Learn the healthy reference from RECORDINGs of healthy running.

    Recordings are cellwatt's own (.mcap, or their folder) or tables (.parquet, .csv) with columns t (s),
    q_1 … q_n (rad) and power (W). Each task must be seen three times or more at each speed.
    """
    learned, tasks = learn_from(frames_of_files(recordings), _robot_name(robot), arm, power)
    save(learned, out)
    report = _report(learned, tasks, out)
    click.echo(json.dumps(report) if as_json else _in_words(report))


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
    if robot is None or not robot.endswith((".yaml", ".yml")):
        return robot
    try:
        content = yaml.safe_load(Path(robot).read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ConfigError(f"--robot {robot}: cannot be read: {str(error).splitlines()[0]}") from error
    name = content.get("robot") if isinstance(content, dict) else None
    if not isinstance(name, str):
        raise ConfigError(f"--robot {robot}: has no key robot with a name")
    return name


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
