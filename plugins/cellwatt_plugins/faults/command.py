"""``cellwatt reference`` learns healthy cycles; ``cellwatt faults`` compares other cycles with them.

Options without a parameter of their own are passed to the function of the same name in ``api``.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cellwatt.commands.options import INPUT, FiniteRange, with_columns, with_progress, with_scheduler
from cellwatt.files import write_file
from cellwatt.progress import stage
from cellwatt.report.page import PAGE
from cellwatt_plugins.faults import api
from cellwatt_plugins.faults.train_command import train
from cellwatt_plugins.robot_option import ROBOT

if TYPE_CHECKING:
    from cellwatt_plugins.faults.cycles.findings import CycleFinding

JUDGE = "judge"
"""Default subcommand of `cellwatt faults`."""
METER = "Table of power (t, power) from a meter with its own clock, one per recording."


@click.command(short_help="Learn how healthy cycles look.")
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...", type=INPUT)
@click.option("--out", required=True, type=click.Path(dir_okay=False, path_type=Path), help="Reference file to write.")
@click.option("--robot", help="Name of the robot, or its description, its folder, or a packaged robot.")
@click.option("--meter", multiple=True, type=INPUT, help=METER)
@click.option("--arm", help="Source with the joints, if several have joints.")
@click.option("--power", default="supply.power", show_default=True, help="Channel of the power.")
@click.option("--json", "as_json", is_flag=True, help="Report as JSON.")
@with_columns
@with_progress
@with_scheduler
def reference(out: Path, as_json: bool, **asked: Any) -> None:
    """Learn the healthy reference from RECORDINGs of a healthy robot.

    Recordings are cellwatt's own (.mcap, or their folder) or tables (.parquet, .csv) with columns t (s),
    q_1 … q_n (rad) and power (W). Each task must occur three times, and twice at each speed.
    """
    learned = api.reference(**asked)
    if learned.note:
        click.echo(learned.note, err=True)
    learned.save(out)
    report = {"file": str(out), **learned.as_json()}
    click.echo(json.dumps(report) if as_json else _in_words(report))


class _Faults(click.Group):
    """Runs ``judge`` unless the first argument is a subcommand of the group."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] not in {*self.commands, *ctx.help_option_names}:
            args = [JUDGE, *args]
        return super().parse_args(ctx, args)


@click.group(cls=_Faults, short_help="Judge recorded cycles against healthy ones.")
def faults() -> None:
    """Find faults (`cellwatt faults RECORDING... --reference FILE`), or train networks that do (`faults train`)."""


@faults.command(JUDGE)
@click.argument("recordings", nargs=-1, required=True, metavar="RECORDING...", type=INPUT)
@click.option("--reference", required=True, type=INPUT, help="File made by `cellwatt reference`.")
@click.option("--robot", type=ROBOT, help="The robot's description, if the reference was learned with it.")
@click.option("--out", type=click.Path(dir_okay=False, path_type=Path), help="findings.json to write.")
@click.option("--meter", multiple=True, type=INPUT, help=METER)
@click.option("--arm", help="Source with the joints; default: that of the reference.")
@click.option("--power", help="Channel of the power; default: that of the reference.")
@click.option(
    "--false-alarms",
    type=FiniteRange(0.0, 0.1, min_open=True),
    default=1e-4,
    show_default=True,
    help="Accepted share of healthy intervals with a false alarm.",
)
@click.option("--report", "page", type=click.Path(dir_okay=False, path_type=Path), help=PAGE)
@click.option("--json", "as_json", is_flag=True, help="Print findings.json.")
@with_columns
@with_progress
@with_scheduler
def judge(out: Path | None, page: Path | None, as_json: bool, **asked: Any) -> None:
    """Compare every cycle of RECORDINGs with healthy ones: report harmless changes and faulty joints or encoders.

    RECORDINGs are as for `cellwatt reference`. --robot needs a reference that was learned with the same description.
    """
    found = api.faults(**asked)
    content = found.as_json()
    if out is not None:
        write_file(out, json.dumps(content, indent=1))
    if page is not None:
        with stage("writing the report"):
            found.report(page)
        click.echo(f"written to {page}", err=True)
    click.echo(json.dumps(content) if as_json else _findings_in_words(found.cycles, out))


faults.add_command(train)


def _findings_in_words(found: Sequence[CycleFinding], out: Path | None) -> str:
    lines = []
    for cycle in found:
        speed = "" if cycle.speed is None else f" at speed {cycle.speed:.2f}"
        note = f": {cycle.note}" if cycle.note else ""
        lines.append(f"{cycle.start:9.2f} … {cycle.end:.2f} s  {cycle.task}{speed}  {cycle.status}{note}")
        lines += [f"{'':12}{fault.statement}" for fault in cycle.faults]
    count = Counter(cycle.status for cycle in found)
    counts = ", ".join(f"{n} {status}" for status, n in sorted(count.items()))
    lines.append(f"{len(found)} cycles: {counts}" if found else "no cycle was judged: no task is complete in RECORDING")
    return "\n".join([*lines, f"written to {out}"] if out else lines)


def _in_words(report: dict[str, Any]) -> str:
    lines = []
    for task in report["tasks"]:
        variants = ", ".join(f"{v['cycles']} cycles at speed {v['speed']:.2f}" for v in task["variants"])
        lines.append(f"{task['name']}: {task['variants'][0]['intervals']} moves, {variants}")
    if report["cycles_left_out"]:
        lines.append(f"{report['cycles_left_out']} cycles not used: too few at their speed")
    lines += [
        f"whole cycles of {p['task']}: {p['moves']} moves, {p['cycles']} cycles at speed {p['speed']:.2f}"
        for p in report["whole_cycles"]
    ]
    if report["meter"]:
        lines.append(f"power is from a slow meter ({report['meter']}): compared with means over the same times")
    return "\n".join([*lines, f"written to {report['file']}"])
