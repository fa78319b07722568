"""Thresholds, a plain comparison of codes, the paper's network, and `faults` with `robot`: on the same cycles of cells
that nobody has looked at; and the first three on the printed tables with wrong codes.

The networks learn from springs on the product's own model of the arm. The plant that runs the cycles has another
engine's rigid bodies, and friction, supply and faults of its own.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellwatt.scheduler import spread
from cellwatt_plugins.faults.cycles.findings import judge_recording
from cellwatt_plugins.faults.cycles.identify import FittedArm
from cellwatt_plugins.faults.cycles.known import learn_known
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.paper.columns import column_of, simulated
from cellwatt_plugins.faults.paper.course import Course
from cellwatt_plugins.faults.paper.expected import ExpectedInterval, fault_table
from cellwatt_plugins.faults.paper.judging import Isolation, by_agreement
from cellwatt_plugins.faults.paper.network import FaultNetwork, train
from cellwatt_plugins.robot import Arm
from faults.cases import make_case
from faults.paper import AS_IN_THE_PAPER, Isolate, judge_recording_by_paper, of_the_motion
from faults.runner import Cell, _shares, watch
from faults.scoring import Count, count
from faults.tables import PICK_AND_PLACE, POLISHING

Codes = NDArray[np.int8]


Counts = dict[str, Count]
"""Counts by method."""


def network_figures(wanted: Sequence[Cell]) -> dict[str, Any]:
    """Figures of every method, and of the printed tables."""
    totals: Counts = {}
    for found in spread(_one_cell, wanted, "cells"):
        totals = {method: totals.get(method, Count()) + each for method, each in found.items()}
    return {"methods": {method: _shares(found) for method, found in totals.items()}, "tables": table_figures()}


def _one_cell(cell: Cell) -> Counts:
    with tempfile.TemporaryDirectory() as folder:
        case = make_case(cell.seed, Path(folder), cell.cycles)
        known = learn_known(Recording(*case.healthy), Arm.load(case.robot))
    healthy, judged = Recording(*case.healthy), Recording(*case.judged)
    physics = [told.finding for told in watch(known, judged) if told.over]
    totals = {"faults_with_robot": count(case.truths, physics, None)}
    healthy_cycles = judge_recording(healthy, known)
    tables = _Tables(known.arm)
    ways: dict[str, Isolate] = {
        "thresholds_compared_with_the_motion": lambda expected: by_agreement(fault_table(expected)),
        "paper_network_of_the_motion": of_the_motion,
        "thresholds_compared_with_a_learnt_table": lambda expected: by_agreement(tables.of(expected), signed=True),
        "paper_network_of_a_learnt_table": tables.network,
    }
    for method, isolation in ways.items():
        found = judge_recording_by_paper(healthy, healthy_cycles, judged, physics, isolation)
        totals[method] = count(case.truths, found, None)
    return totals


@dataclass
class _Tables:
    """Tables of springs on the arm as it was fitted."""

    arm: FittedArm
    learnt: dict[int, Codes] = field(default_factory=dict)

    def of(self, expected: Sequence[ExpectedInterval]) -> Codes:
        """The signed table of a task."""
        if id(expected) not in self.learnt:
            course = Course("", 1.0, tuple(expected))
            moving = fault_table(expected).any(axis=0)
            nothing = np.zeros(len(expected), np.int8)
            columns = [
                column_of(simulated(self.arm, course, j + 1, AS_IN_THE_PAPER)) if moving[j] else nothing
                for j in range(len(moving))
            ]
            self.learnt[id(expected)] = np.stack(columns, axis=1)
        return self.learnt[id(expected)]

    def network(self, expected: Sequence[ExpectedInterval]) -> Isolation:
        """The paper's network of it; nothing is named where no joint has a code."""
        table = self.of(expected)
        return FaultNetwork(train(table, signed=True)).joints if table.any() else lambda codes: ()


def table_figures() -> dict[str, Any]:
    """Share of codes that are named rightly where one or two of them are wrong, every possible way."""
    out: dict[str, Any] = {}
    for name, table in (("table_I", PICK_AND_PLACE), ("table_II", POLISHING)):
        network = FaultNetwork(train(table))
        compare = by_agreement(table, signed=True)
        for wrong in (1, 2):
            cases = [(j, codes) for j in range(table.shape[1]) for codes in _with_wrong(table[:, j], wrong)]
            out[f"{name}_{wrong}_wrong"] = {
                "cases": len(cases),
                "paper_network": round(float(np.mean([network.joints(c)[:1] == (j + 1,) for j, c in cases])), 3),
                "compared": round(float(np.mean([compare(c)[:1] == (j + 1,) for j, c in cases])), 3),
            }
    return out


def _with_wrong(column: Codes, number: int) -> list[Codes]:
    """A column with so many codes replaced by each of the two others."""
    out = []
    for places in combinations(range(len(column)), number):
        for values in product(*([v for v in (-1, 0, 1) if v != column[place]] for place in places)):
            changed = column.copy()
            changed[list(places)] = values
            out.append(changed)
    return out
