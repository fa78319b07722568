"""Compares the demo's arm with its simulation: ``cellwatt explain`` on the recording so far, while the demo runs."""

from __future__ import annotations

import asyncio
import json
import logging
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from cellwatt.child import output
from cellwatt.demo.cells import SHAPE
from cellwatt.emulation import ArmSignals
from cellwatt.record import Recording
from cellwatt.tables import write_table

ARM = "arm"
JOINTS = 6
REPORTS = "reports"
"""Folder beside the recording whose reports the page shows."""
RECORDED = (("q", "position"), ("qd", "velocity"), ("current", "current"))
SECONDS = "15"
"""Computing time, s, allowed for ``explain``."""
LIMIT, NICENESS = 600.0, 10


async def compared(folder: Path, name: str, epoch: float, since: float, until: float) -> str:
    """Run ``explain`` on the recording between two UTC times, s; return its findings as text.

    ``epoch`` is the UTC time, s, at which the emulated arm started. Raises ``CellwattError`` if explain fails.
    """
    out = folder / REPORTS / name
    recording, simulation = await asyncio.to_thread(write_run, folder, out, epoch, since, until)
    words = ["cellwatt.commands", "explain", str(recording), "--simulation", str(simulation), "--quiet"]
    words += ["--robot", str(SHAPE.with_name("robot.yaml")), "--out", str(out), "--time", SECONDS]
    await output(words, LIMIT, NICENESS)
    found = json.loads(await asyncio.to_thread((out / "findings.json").read_text))
    statements = [finding["statement"] for finding in found["findings"]]
    return " ".join(statements) or "recording and simulation agree within noise and tolerances."


def write_run(folder: Path, out: Path, epoch: float, since: float, until: float) -> tuple[Path, Path]:
    """Write the frames between two UTC times, and the simulation of the same motion, as two Parquet files.

    Raises ``RecordingError`` if there is no recording, or it has no frames between these times.
    """
    out.mkdir(parents=True, exist_ok=True)
    names = [f"{ARM}.joint_{joint}.{quantity}" for _, quantity in RECORDED for joint in range(1, JOINTS + 1)]
    with _quiet():
        frames = Recording.open(folder).between(round(since * 1e9), round(until * 1e9)).frames_table()
    time = np.asarray(frames.time * 1e-9, np.float64)
    values = frames.values[:, [frames.layout.index(name) for name in names]]
    labels = [f"{short}_{joint}" for short, _ in RECORDED for joint in range(1, JOINTS + 1)]
    recording, simulation = out / "recording.parquet", out / "simulation.parquet"
    write_table(recording, {"t": time - since, **dict(zip(labels, values.T, strict=True))})
    arm = ArmSignals()
    planned = arm.motion(time - epoch)
    torque, _ = arm.torque(time - epoch, *planned)
    columns = {"t": time - since}
    for short, values in zip(("q", "qd", "qdd", "tau"), (*planned, torque), strict=True):
        columns |= {f"{short}_{joint + 1}": values[:, joint] for joint in range(JOINTS)}
    write_table(simulation, columns)
    return recording, simulation


@contextmanager
def _quiet() -> Iterator[None]:
    """Suppress the reader's warnings about a file that is still being written."""
    log = logging.getLogger("cellwatt.record.reader")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(level)
