"""Runs every case and prints the figures."""

from __future__ import annotations

import argparse
import dataclasses
import json
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cellwatt.progress import show_progress
from cellwatt.scheduler import scheduled, spread
from cellwatt_plugins.faults.cycles.bare_arm import BareArm
from cellwatt_plugins.faults.cycles.findings import CycleFinding, judge_recording
from cellwatt_plugins.faults.cycles.known import Known, learn_known
from cellwatt_plugins.faults.cycles.live import CycleWatch
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.robot import Arm
from faults.cases import Case, make_case
from faults.paper import judge_recording_by_paper
from faults.scoring import Count, count

BLOCK = 25
"""Frames given at a time, as the daemon does."""


@dataclass
class Figures:
    """Counts of ours and of the paper's method, by samples and by energies; processor time ``spent`` on ``watched`` s
    of frames, live."""

    ours: Count = field(default_factory=Count)
    paper: Count = field(default_factory=Count)
    paper_by_energy: Count = field(default_factory=Count)
    spent: float = 0.0
    watched: float = 0.0

    def __add__(self, other: Figures) -> Figures:
        """Both together."""
        return Figures(*(getattr(self, f.name) + getattr(other, f.name) for f in dataclasses.fields(self)))


@dataclass(frozen=True)
class Cell:
    """A cell to draw by its seed, and how many cycles to judge in it."""

    seed: int
    cycles: int
    bare: bool = False
    """Without the description of the arm."""


def main() -> None:
    """See the module `faults`."""
    parse = argparse.ArgumentParser(description=__doc__)
    parse.add_argument("--json", action="store_true", help="print figures as JSON")
    parse.add_argument("--cases", type=int, default=10, help="cells of an arm and three tasks each")
    parse.add_argument("--cycles", type=int, default=50, help="cycles to judge in each")
    parse.add_argument("--first-seed", type=int, default=0)
    parse.add_argument("--bare", action="store_true", help="leave the description of the arm out")
    parse.add_argument("--healthy", action="store_true", help="count false alarms in calm cycles instead")
    parse.add_argument("--edited", action="store_true", help="count false alarms in edited tasks instead")
    parse.add_argument("--scheduler", metavar="PLACE", help="whose workers do the cells, as of cellwatt's commands")
    given = parse.parse_args()
    with show_progress(), scheduled(given.scheduler):
        print(in_words(asked_for(given), given.json))


def asked_for(given: argparse.Namespace) -> dict[str, Any]:
    """The figures that the command line asks for."""
    seeds = range(given.first_seed, given.first_seed + given.cases)
    wanted = [Cell(seed, given.cycles, given.bare) for seed in seeds]
    if given.edited:
        return edited_figures(wanted)
    if given.healthy:
        from faults.healthy import healthy_figures

        return healthy_figures(wanted)
    return summary(sum(spread(judged, wanted, "cells"), Figures()))


def judged(cell: Cell) -> Figures:
    """Figures of one cell."""
    with tempfile.TemporaryDirectory() as folder:
        return judge(make_case(cell.seed, Path(folder), cell.cycles), cell.bare)


def edited_figures(wanted: Sequence[Cell]) -> dict[str, Any]:
    """How often a known task with a changed pose is taken for a fault: while it runs, and at its end."""
    found = spread(edited, wanted, "cells")
    total, at_the_end = (sum(counts, Count()) for counts in zip(*found, strict=True))
    return {
        "cycles": total.cycles,
        "false_alarms": total.false_alarms,
        "false_alarms_at_the_end": at_the_end.false_alarms,
        "new_tasks_recognised": total.new_tasks_recognised,
    }


def edited(cell: Cell) -> tuple[Count, Count]:
    """Counts of one cell in which a pose of each task was changed: of all that is told, and of what is at the end."""
    with tempfile.TemporaryDirectory() as folder:
        case = make_case(cell.seed, Path(folder), cell.cycles, edited=True)
        known = learn_known(Recording(*case.healthy), Arm.load(case.robot))
    found, early = watch(known, Recording(*case.judged))
    return count(case.truths, found, early), count(case.truths, found, [])


def judge(case: Case, bare: bool = False) -> Figures:
    """Both methods on one case, ours with the description of the arm or with a bare one."""
    healthy, judged = Recording(*case.healthy), Recording(*case.judged)
    known = learn_known(healthy, BareArm(np.ones(healthy.joints)) if bare else Arm.load(case.robot))
    start = time.process_time()
    found, early = watch(known, judged)
    spent = time.process_time() - start
    cycles = judge_recording(healthy, known)
    by_energy = judge_recording_by_paper(healthy, cycles, judged, found, residual="energy")
    return Figures(
        count(case.truths, found, early),
        count(case.truths, judge_recording_by_paper(healthy, cycles, judged, found), None),
        count(case.truths, by_energy, None),
        spent,
        float(judged.time[-1] - judged.time[0]),
    )


def watch(known: Known, judged: Recording) -> tuple[list[CycleFinding], list[CycleFinding]]:
    """What is told of a recording that comes block by block: of cycles that are over, and of those that run."""
    live, out = CycleWatch(known, judged.step), []
    for begin in range(0, len(judged.time), BLOCK):
        part = slice(begin, begin + BLOCK)
        out += live.feed(judged.time[part], judged.position[part], judged.power[part])
    out += live.close()
    return [report.finding for report in out if report.over], [report.finding for report in out if not report.over]


def summary(figures: Figures) -> dict[str, Any]:
    """The shares that count and the counts behind them, and those of the paper's method under its name."""
    cost = {"cells_on_one_core": round(figures.watched / max(figures.spent, 1e-9), 1)}
    paper = {"paper": _shares(figures.paper), "paper_by_energy": _shares(figures.paper_by_energy)}
    return {**_shares(figures.ours), **cost, **paper}


def _shares(total: Count) -> dict[str, float]:
    return {
        "isolation_accuracy": round(total.isolated / max(1, total.clear_faults), 4),
        "detected_in_first_interval": round(total.in_first_interval / max(1, total.clear_faults), 4),
        "isolated_in_first_interval": round(total.named_alone_in_first_interval / max(1, total.clear_faults), 4),
        "detected_by_next_interval": round(total.by_next_interval / max(1, total.clear_faults), 4),
        "first_interval_at_best": round(total.told_at_best / max(1, total.clear_faults), 4),
        "false_alarms_per_10000_intervals": round(1e4 * total.false_intervals / max(1, total.calm_intervals), 2),
        **dataclasses.asdict(total),
    }


def in_words(figures: dict[str, Any], as_json: bool, indent: str = "") -> str:
    """One figure a line, or JSON."""
    if as_json:
        return json.dumps(figures)
    lines = []
    for name, value in figures.items():
        below = f"\n{in_words(value, False, indent + '  ')}" if isinstance(value, dict) else f" {value}"
        lines.append(f"{indent}{name:34}{below}")
    return "\n".join(lines)
