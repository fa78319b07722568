"""The paper's method with the mean of healthy cycles or BEVF's equation as reference, codes by samples or by energy.

    python bench/faults/paper_model.py

The emulated IRB 1200 runs both tasks with friction added to one joint at a time, and healthy cycles with other noise.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from bench.faults.paper import from_cycles, judge  # noqa: E402
from tests.plugins.faults.paper.irb1200 import PICK_AND_PLACE, POLISHING, Fault, Run, period, run  # noqa: E402

from cellwatt_plugins.faults.criteria import Tolerance  # noqa: E402
from cellwatt_plugins.faults.paper.bevf import ORDERS, fit  # noqa: E402
from cellwatt_plugins.faults.paper.codes import Residual  # noqa: E402
from cellwatt_plugins.faults.paper.expected import ExpectedInterval, Readings, fault_table  # noqa: E402
from cellwatt_plugins.faults.paper.judging import by_agreement  # noqa: E402

BEFORE = 0.3
"""s of rest that belong to a cycle before its first motion."""
FRICTION = (5.0, 8.0, 12.0, 20.0)
"""Nm."""
HEALTHY = 20
TASKS = {"pick-and-place": PICK_AND_PLACE, "polishing": POLISHING}


def cycles(plan: Run) -> list[Readings]:
    """A run, cycle by cycle."""
    told = run(plan)
    length = period(plan.moves, plan.speed)
    parts = [(told.t >= start - BEFORE) & (told.t < start + length - BEFORE) for start in told.starts]
    return [Readings(told.t[m] - start, told.q[m], told.power[m]) for m, start in zip(parts, told.starts, strict=True)]


def references(healthy: Sequence[Readings]) -> dict[str, tuple[ExpectedInterval, ...]]:
    """The mean of healthy cycles, and the equation of each order fitted to it."""
    mean = from_cycles(healthy)
    t = np.arange(0.0, mean[-1].end, 1 / 123)
    power = np.mean([np.interp(t, cycle.t, cycle.power) for cycle in healthy], axis=0)
    found = {"mean": mean}
    for order in ORDERS:
        equation = fit(t, power, order=order)
        found[f"BEVF {order}"] = tuple(
            replace(i, readings=replace(i.readings, power=equation.power(np.maximum(i.readings.t, 0.0)))) for i in mean
        )
    return found


def main() -> None:
    tolerance = Tolerance(power=0.10, floor=0.0)
    print("| task | reference | codes | faults named | of them right | healthy cycles with a false alarm |")
    print("|---" * 6 + "|")
    for task, moves in TASKS.items():
        healthy = cycles(Run(moves, HEALTHY, lead=1.0, seed=90))
        faulty = [
            (joint, cycles(Run(moves, 1, 1.0, (Fault("friction", joint, size),), lead=1.0, seed=joint))[0])
            for joint in range(1, 7)
            for size in FRICTION
        ]
        for name, expected in references(cycles(Run(moves, 6, lead=1.0, seed=1))).items():
            isolate = by_agreement(fault_table(expected))
            for residual in get_args(Residual):
                told = [(joint, judge(expected, cycle, isolate, tolerance, residual)) for joint, cycle in faulty]
                named = [(joint, found[0]) for joint, found in told if found]
                right = sum(joint in (first.joint, *first.alternatives) for joint, first in named)
                false = sum(bool(judge(expected, cycle, isolate, tolerance, residual)) for cycle in healthy)
                print(
                    f"| {task} | {name} | {residual} | {len(named)} of {len(faulty)} | {right} | {false} of {HEALTHY} |"
                )


if __name__ == "__main__":
    main()
