"""Recordings of real arms beside the checkout: which tasks are found, and what can be said of their faults.

None of them has cycles with supply power and a fault at once, so each shows a part only; see docs/proof-faults.md.
"""

from __future__ import annotations

import csv
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
from concealed.arms import Array

from cellwatt.errors import RecordingError
from cellwatt_plugins.faults.cycles.learn import learn_patterns
from cellwatt_plugins.faults.cycles.match import find_cycles
from cellwatt_plugins.faults.cycles.recording import Recording
from cellwatt_plugins.faults.cycles.runs import find_runs
from cellwatt_plugins.faults.cycles.strangers import new_tasks

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"
STEP = 0.05
"""s between the UR3e's samples."""
REST = 1.0
"""s at rest put between recordings that are laid one after the other."""
LEARNED = ("wgo", "wgo2", "wgo3", "wgo4")
JUDGED = ("wgo5", "2_blocks", "2_blocks_v2", "2_blocks_v3", "heart")
BEFORE = 100
"""A servo's reading is held against the median of so many before it."""
QUANTILE = 0.9999
"""Healthy readings below the limit, in the recording that sets it."""


def real_figures() -> dict[str, Any]:
    """Figures of all three sets. Raises ``RecordingError`` where they are not beside the checkout."""
    if not DATA.is_dir():
        raise RecordingError("no recordings of real arms in ../shared/data beside the checkout")
    return {
        "ur3e_pick_and_place": _pick_and_place(DATA / "ur3e_pick_and_place"),
        "servo_arm_faults": _servos(DATA / "servo_arm_faults"),
        "yucobot_sample": _excerpts(DATA / "yucobot_sample"),
    }


def _pick_and_place(folder: Path) -> dict[str, Any]:
    """Encoders alone: tasks learned from some recordings, known again in others, and said to be new elsewhere."""
    patterns = learn_patterns(_one_after_the_other([_ur3e(folder / f"earlier/robot_output_{n}.csv") for n in LEARNED]))
    out: dict[str, Any] = {"tasks_learned": [len(pattern.moves) for pattern in patterns]}
    files = {name: f"earlier/robot_output_{name}.csv" for name in JUDGED}
    for name, file in {**files, "no_faults": "robot_output/no_faults_robot_output.csv"}.items():
        recording = _ur3e(folder / file)
        runs = find_runs(recording)
        found = find_cycles(recording, runs, patterns)
        out[name] = {
            "moves": len(runs),
            "known_cycles": len(found),
            "new_tasks": len(new_tasks(runs, found, patterns)),
            "encoder_alarms": sum(len(match.odd) for match in found),
        }
    return out


def _ur3e(file: Path) -> Recording:
    """Positions on an even grid; there is no power."""
    with file.open() as lines:
        rows = [row for row in csv.DictReader(lines, delimiter=" ") if row["actual_q_5"]]
    time = np.array([float(row["timestamp"]) for row in rows])
    position = np.array([[float(row[f"actual_q_{j}"]) for j in range(6)] for row in rows])
    rising = np.concatenate([[True], np.diff(time) > 0])
    grid = np.arange(time[0], time[-1], STEP)
    even = np.column_stack([np.interp(grid, time[rising], column[rising]) for column in position.T])
    return Recording(grid - grid[0], even, np.zeros(len(grid)))


def _one_after_the_other(parts: Sequence[Recording]) -> Recording:
    rest = round(REST / STEP)
    position = np.concatenate([np.pad(p.position, ((rest, rest), (0, 0)), mode="edge") for p in parts])
    return replace(parts[0], time=STEP * np.arange(len(position)), position=position, power=np.zeros(len(position)))


def _servos(folder: Path) -> dict[str, Any]:
    """How well each reading of a servo tells the labelled faults: by how far it is from its last ones."""
    healthy = [_servo(file) for file in sorted((folder / "wp3_collected" / "task_normal").glob("*.csv"))]
    others = [_servo(file) for file in sorted(folder.glob("*/*/*.csv")) if file.parent.name != "task_normal"]
    label = np.concatenate([columns["label"][BEFORE:] for columns in others]) > 0
    out: dict[str, Any] = {"readings": len(label), "faulty": int(label.sum())}
    for name in ("position", "voltage", "temperature"):
        score = np.concatenate([_departure(columns[name]) for columns in others])
        limit = np.quantile(np.concatenate([_departure(columns[name]) for columns in healthy]), QUANTILE)
        out[name] = {
            "auroc": round(auroc(score, label), 3),
            "found": round(float(np.mean(score[label] > limit)), 3),
            "false_alarms_per_10000_readings": round(1e4 * float(np.mean(score[~label] > limit)), 1),
        }
    return out


def _servo(file: Path) -> dict[str, Array]:
    with file.open() as lines:
        rows = [{key.strip(): value for key, value in row.items()} for row in csv.DictReader(lines)]
    return {
        name: np.array([float(row[name]) for row in rows]) for name in ("position", "voltage", "temperature", "label")
    }


def _departure(values: Array) -> Array:
    """How far each value is from the median of those before it; for all but the first ``BEFORE``."""
    if len(values) <= BEFORE:
        return np.empty(0)
    windows = np.lib.stride_tricks.sliding_window_view(values, BEFORE)[:-1]
    return np.abs(values[BEFORE:] - np.median(windows, axis=1))


def auroc(score: Array, faulty: Array) -> float:
    """Probability that a faulty sample scores higher than a healthy one; equals count half."""
    healthy, ill = np.sort(score[~faulty]), score[faulty]
    below = np.searchsorted(healthy, ill, side="left") + np.searchsorted(healthy, ill, side="right")
    return float(np.mean(below) / 2 / len(healthy))


def _excerpts(folder: Path) -> dict[str, Any]:
    """One second of each: how far its power is from that of the healthy ones."""
    table = pq.read_table(folder / "test.parquet")
    column = {n: table[n].to_numpy() for n in ("sample", "anomaly", "time", "robot_voltage", "robot_current")}
    power: dict[int, Array] = {}
    faulty = set()
    grid = np.arange(0.05, 0.95, 0.01)
    for sample in np.unique(column["sample"]).tolist():
        rows = column["sample"] == sample
        watts = column["robot_voltage"][rows] * column["robot_current"][rows]
        power[sample] = np.interp(grid, column["time"][rows], watts)
        faulty |= {sample} if column["anomaly"][rows].any() else set()
    scores = {}
    for sample, watts in power.items():
        healthy = [other for name, other in power.items() if name not in faulty and name != sample]
        scores[sample] = float(np.sqrt(np.mean((watts - np.mean(healthy, axis=0)) ** 2)))
    return {"rms_W": {str(name): round(rms, 2) for name, rms in scores.items()}, "faulty": sorted(faulty)}
