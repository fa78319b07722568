"""The ``energy`` stage on a task of a simulated arm, as frames: does its split hold, and does it add up?"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from cellwatt import CellInfo, FrameChannel, Frames, Layout
from cellwatt.frames import cut
from cellwatt.results import Alarm, Energy, Task
from cellwatt_plugins.energy.stage import EnergySettings, EnergyStage
from cellwatt_plugins.segment import SegmentSettings, SegmentStage

from .arms import Case
from .plant import production

RATE = 50.0
BLOCK = 25
"""Frames a call."""
BEGIN = 1_700_000_000 * 10**9


def frames_of(seen: dict[str, np.ndarray], power: np.ndarray) -> Frames:
    """All of a production as one block on the grid."""
    names = [f"arm.joint_{i + 1}.{q}" for q in seen for i in range(seen[q].shape[1])]
    units = {"position": "rad", "velocity": "rad/s", "torque": "Nm"}
    channels = [FrameChannel(n, units[n.rsplit(".", 1)[1]], "continuous", "linear") for n in names]
    layout = Layout((*channels, FrameChannel("meter.supply.power", "W", "continuous", "linear")), RATE)
    values = np.column_stack([*seen.values(), power])
    still = np.zeros(values.shape, np.int64)
    time = BEGIN + np.arange(len(values)) * layout.step
    return Frames(layout, 0, time, values, still.astype(np.uint8), still)


def run_stages(frames: Frames, folder: Path, **settings) -> list:
    """Results of segment and energy together, in order; settings beyond the files as given."""
    cell = CellInfo("bench", "cell", None, folder)
    chosen = EnergySettings(robot=Path("robot.yaml"), balance=Path("out/energy.json"), **settings)
    energy = EnergyStage("energy", chosen, frames.layout, cell)
    segment = SegmentStage("segment", SegmentSettings(), frames.layout, cell)
    out: list = []
    for a in range(0, len(frames), BLOCK):
        block = cut(frames, a, min(a + BLOCK, len(frames)))
        found = list(segment.process(block, ()))
        out += [*found, *energy.process(block, found)]
    found = list(segment.close())
    return [*out, *found, *energy.process(cut(frames, len(frames), len(frames)), found), *energy.close()]


def measure_live(case: Case, key: dict, folder: Path, speed: float, payload: float) -> dict:
    """Worst error of each group of a task, per cent of its energy, and of what is in no group; that also in sigmas."""
    seen, power, means = production(case, key["fixed"], speed, payload, 6, 2.0, RATE)
    results = run_stages(frames_of(seen, power), folder)
    tasks = [r for r in results if isinstance(r, Task)]
    told = {r.end: r for r in results if isinstance(r, Energy)}
    errors: dict[str, float] = {}
    for task in tasks:
        first, last = (round((t - BEGIN) * RATE * 1e-9) for t in (task.start, task.end))
        true = {k: float(v[first:last].sum() / RATE) for k, v in means.items()}
        true = {
            "mechanical_losses": true["mechanical"],
            "electrical_losses": true["electrical"],
            "regeneration": true["chopper"],
            "positive_mechanical": true["positive"],
        }
        total = float(power[first:last].sum() / RATE)
        for name, value in true.items():
            said = told[task.end].positive_mechanical if name.startswith("positive") else told[task.end].groups[name]
            off = 100 * abs(said - value) / total
            errors[name] = max(errors.get(name, 0.0), off)
        left, unsure = abs(told[task.end].groups["unexplained"]), told[task.end].uncertainty
        errors["unexplained"] = max(errors.get("unexplained", 0.0), 100 * left / total)
        errors["unexplained_sigmas"] = max(errors.get("unexplained_sigmas", 0.0), left / unsure)
    alarms = sorted({r.kind for r in results if isinstance(r, Alarm)})
    return {"tasks": len(tasks), "alarms": alarms, **{k: round(v, 3) for k, v in errors.items()}}
