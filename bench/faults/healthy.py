"""False alarms in calm cycles, by the share of intervals in which one is accepted."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from cellwatt.scheduler import spread
from cellwatt_plugins.faults.cycles.findings import CycleFinding, judge_recording
from cellwatt_plugins.faults.cycles.known import Known, learn_known
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.robot import Arm
from faults.cases import make_case
from faults.runner import Cell

ACCEPTED = (0.1, 1e-2, 1e-3, 1e-4)
"""Shares of healthy intervals in which a false alarm is accepted."""
AROUND = 2.0
"""s of the recording around a cycle that is judged again."""


def healthy_figures(wanted: Sequence[Cell]) -> dict[str, Any]:
    """Intervals with a false alarm at each accepted share; half of the cycles are changed harmlessly."""
    found = spread(calm, wanted, "cells")
    intervals = sum(count for count, _ in found)
    alarms = {accepted: sum(of[accepted] for _, of in found) for accepted in ACCEPTED}
    shares = {f"at_{accepted:g}": round(count / intervals, 6) for accepted, count in alarms.items()}
    return {"intervals": intervals, "false_alarms": {f"at_{a:g}": n for a, n in alarms.items()}, "share": shares}


def calm(cell: Cell) -> tuple[int, dict[float, int]]:
    """Intervals of one cell without faults, and false alarms in them at each accepted share."""
    with tempfile.TemporaryDirectory() as folder:
        case = make_case(cell.seed, Path(folder), cell.cycles, calm=True)
        known = learn_known(Recording(*case.healthy), Arm.load(case.robot))
    return sum(truth.moves for truth in case.truths), false_intervals(Recording(*case.judged), known)


def false_intervals(recording: Recording, known: Known) -> dict[float, int]:
    """Intervals with a false alarm at each accepted share: what is told at one is looked at again at the next."""
    suspects: Sequence[CycleFinding] = judge_recording(recording, replace(known, false_alarms=ACCEPTED[0]))
    out: dict[float, int] = {}
    for accepted in ACCEPTED:
        if accepted != ACCEPTED[0]:
            strict = replace(known, false_alarms=accepted)
            suspects = [again for cycle in suspects for again in judge_recording(_part(recording, cycle), strict)]
        suspects = [cycle for cycle in suspects if cycle.faults]
        out[accepted] = sum(len({move for f in cycle.faults for move in f.intervals}) for cycle in suspects)
    return out


def _part(recording: Recording, cycle: CycleFinding) -> Recording:
    inside = (recording.time > cycle.start - AROUND) & (recording.time < cycle.end + AROUND)
    return Recording(recording.time[inside], recording.position[inside], recording.power[inside])
