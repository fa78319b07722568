"""Runs every case and prints the figures."""

from __future__ import annotations

import argparse
import dataclasses
import json
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from cellwatt_plugins.faults.cycles.findings import CycleFinding, judge_recording
from cellwatt_plugins.faults.cycles.known import learn_known
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.robot import load_robot
from faults.cases import Case, make_case
from faults.scoring import Count, count


def main() -> None:
    """See the module `faults`."""
    parse = argparse.ArgumentParser(description=__doc__)
    parse.add_argument("--json", action="store_true", help="print figures as JSON")
    parse.add_argument("--cases", type=int, default=10, help="cells of an arm and three tasks each")
    parse.add_argument("--cycles", type=int, default=50, help="cycles to judge in each")
    parse.add_argument("--first-seed", type=int, default=0)
    given = parse.parse_args()
    total, seconds = Count(), 0.0
    for seed in range(given.first_seed, given.first_seed + given.cases):
        with tempfile.TemporaryDirectory() as folder:
            case = make_case(seed, Path(folder), given.cycles)
            found, spent = judge(case)
        total += count(case.truths, found)
        seconds += spent
    figures = summary(total, seconds)
    print(json.dumps(figures) if given.json else "\n".join(f"{name:34} {value}" for name, value in figures.items()))


def judge(case: Case) -> tuple[Sequence[CycleFinding], float]:
    """Findings of a case, and the processor time of judging alone, s."""
    known = learn_known(Recording(*case.healthy), load_robot(case.robot))
    start = time.process_time()
    found = judge_recording(Recording(*case.judged), known)
    return found, time.process_time() - start


def summary(total: Count, seconds: float) -> dict[str, float]:
    """The shares that count, and the counts behind them."""
    return {
        "isolation_accuracy": round(total.isolated / max(1, total.clear_faults), 4),
        "detected_in_first_interval": round(total.first_interval / max(1, total.isolated), 4),
        "false_alarms_per_10000_intervals": round(1e4 * total.false_intervals / max(1, total.calm_intervals), 2),
        "judging_ms_per_cycle": round(1e3 * seconds / max(1, total.cycles), 1),
        **dataclasses.asdict(total),
    }
