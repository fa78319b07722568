"""Thresholds, a plain comparison of codes, the paper's network, the network of a motion, and `faults` with `robot`: on
the same cycles of cells that nobody has looked at; and the first three on the printed tables with wrong codes.

The networks learn from faults that the product injects into its own model of the arm. The plant that runs the cycles
has another engine's rigid bodies, and friction, supply and faults of its own.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cellwatt.onnx_file import OnnxFile
from cellwatt.scheduler import spread
from cellwatt_plugins.faults.ann.exported import exported
from cellwatt_plugins.faults.ann.judging import NetworkJudge
from cellwatt_plugins.faults.ann.network import PatternNetwork
from cellwatt_plugins.faults.ann.training import train as train_motion
from cellwatt_plugins.faults.cycles.findings import CycleFinding, judge_recording
from cellwatt_plugins.faults.cycles.identify import FittedArm
from cellwatt_plugins.faults.cycles.known import learn_known
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.paper.columns import column_of, simulated
from cellwatt_plugins.faults.paper.course import Course
from cellwatt_plugins.faults.paper.expected import ExpectedInterval, fault_table
from cellwatt_plugins.faults.paper.judging import Isolation, by_agreement
from cellwatt_plugins.faults.paper.network import FaultNetwork, train
from cellwatt_plugins.robot import Arm
from faults.cases import Truth, make_case
from faults.paper import AS_IN_THE_PAPER, Isolate, judge_recording_by_paper, of_the_motion
from faults.runner import Cell, _shares, watch
from faults.scoring import Count, count
from faults.tables import PICK_AND_PLACE, POLISHING

Codes = NDArray[np.int8]
SURE = (0.5, 0.8, 0.95, 1.01)
"""Confidence, from each to the next, in which names of the network are counted."""


@dataclass
class Totals:
    """Counts by method; names of the network by confidence, right ones and all; s of a training."""

    counts: dict[str, Count] = field(default_factory=dict)
    named: dict[float, list[int]] = field(default_factory=lambda: {low: [0, 0] for low in SURE[:-1]})
    trained: list[float] = field(default_factory=list)

    def add(self, method: str, truths: Sequence[Truth], found: Sequence[CycleFinding]) -> None:
        """One cell's cycles."""
        self.counts[method] = self.counts.get(method, Count()) + count(truths, found, None)

    def __add__(self, other: Totals) -> Totals:
        """Both together."""
        counts = {method: self.counts.get(method, Count()) + found for method, found in other.counts.items()}
        named = {low: [a + b for a, b in zip(own, other.named[low], strict=True)] for low, own in self.named.items()}
        return Totals(counts, named, self.trained + other.trained)


def network_figures(wanted: Sequence[Cell]) -> dict[str, Any]:
    """Figures of every method, of how sure the network is, and of the printed tables."""
    totals = sum(spread(_one_cell, wanted, "cells"), Totals())
    sure = {f"from_{low:g}": {"right": right, "named": named} for low, (right, named) in totals.named.items()}
    return {
        "methods": {method: _shares(found) for method, found in totals.counts.items()},
        "network_names_by_confidence": sure,
        "training_seconds": round(float(np.median(totals.trained)), 1),
        "tables": table_figures(),
    }


def _one_cell(cell: Cell) -> Totals:
    totals = Totals()
    with tempfile.TemporaryDirectory() as folder:
        case = make_case(cell.seed, Path(folder), cell.cycles)
        known = learn_known(Recording(*case.healthy), Arm.load(case.robot))
    healthy, judged = Recording(*case.healthy), Recording(*case.judged)
    physics = [told.finding for told in watch(known, judged) if told.over]
    totals.add("faults_with_robot", case.truths, physics)
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
        totals.add(method, case.truths, found)
    networks = []
    for pattern in known.patterns:
        start = time.process_time()
        networks.append(PatternNetwork(OnnxFile(exported(train_motion(known.arm, pattern), pattern))))
        totals.trained.append(time.process_time() - start)
    told = [each.finding for each in watch(NetworkJudge(known.patterns, tuple(networks)), judged) if each.over]
    totals.add("network_of_the_motion", case.truths, told)
    _by_confidence(case.truths, told, totals)
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


def _by_confidence(truths: Sequence[Truth], told: Sequence[CycleFinding], totals: Totals) -> None:
    """Joints that the network named, by how sure it was, and how many of them were faulty in that way."""
    for cycle in told:
        truth = max(truths, key=lambda t: min(t.end, cycle.end) - max(t.start, cycle.start))
        wanted = {(fault.joint + 1, fault.kind) for fault in truth.plan.faults}
        for fault in cycle.faults:
            if fault.joint and fault.or_kind is None:
                low = max(each for each in SURE[:-1] if each <= max(fault.confidence, SURE[0]))
                totals.named[low][0] += (fault.joint, fault.kind) in wanted
                totals.named[low][1] += 1


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
