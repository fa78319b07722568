"""Motion of the arm, and of the simulator rolled out under the same commands, original and mended."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cellwatt.arrays import Float
from cellwatt.report import Axis, Figure, Folded, Panel, Section, Switch
from cellwatt.report.drawing import curve
from cellwatt.report.figure import Json
from cellwatt.report.theme import FOUND, MEASURED, MODEL, SIMULATION
from cellwatt_plugins.explain.input.run import Run
from cellwatt_plugins.explain.report.curves import stacked
from cellwatt_plugins.explain.simulators import Simulator
from cellwatt_plugins.explain.simulators.rollout import WINDOW, rms_of, rolled_out

POINTS = 3000
"""Largest number of points of a curve."""
SECONDS = 20.0
"""Seconds shown at first."""
DIGITS = 5
"""Decimals of rad."""


def section(runs: Sequence[Run], simulator: Simulator, mended: Path | None) -> Section:
    """Commanded, measured, simulated and mended motion of each joint; ``mended`` is None without a mended file."""
    before = rolled_out(simulator.path, simulator.joints, runs)
    after = None if mended is None else rolled_out(mended, simulator.joints, runs)
    errors = rms_of(before)
    parts = list[Folded]()
    for joint in np.argsort(-errors).tolist():
        unit = simulator.unit(joint, "rad")
        drawn = [
            _figure(run, joint, unit, before[i].position, None if after is None else after[i].position, i)
            for i, run in enumerate(runs)
        ]
        title = f"Joint {joint + 1}: off by {errors[joint]:.2g} {unit} rms"
        title += "" if after is None else f", mended {rms_of(after)[joint]:.2g} {unit}"
        parts.append(Folded(title, drawn, not parts))
    lead = f"The simulator rolled out under the recorded commands, restarted each {WINDOW:.0f} s where the arm was."
    return Section("How the arm and its simulation move", [Switch("moved", [run.name for run in runs]), *parts], lead)


def _figure(run: Run, joint: int, unit: str, simulated: Float, mended: Float | None, number: int) -> Figure:
    assert run.command is not None
    start = float(run.time[0])

    def drawn(name: str, values: Float, colour: str, width: float) -> Json:
        of = values[:, joint]
        return curve(name, of, colour, start=start, step=run.step, width=width, most=POINTS, decimals=DIGITS)

    upper = [
        drawn("commanded", run.command, FOUND, 1.0),
        drawn("measured", run.position, MEASURED, 2.4),
        drawn("simulation", simulated, SIMULATION, 1.3),
    ]
    lower = [drawn("measured − simulation", run.position - simulated, SIMULATION, 1.1)]
    if mended is not None:
        upper.append(drawn("mended", mended, MODEL, 1.3))
        lower.append(drawn("measured − mended", run.position - mended, MODEL, 1.1))
    x, y = Axis("s", (start, start + SECONDS)), Axis(unit)
    label = f"Joint {joint + 1} in {run.name}: commanded, measured, simulated; and the residuals"
    return stacked(label, Panel(upper, x, y), Panel(lower, x, y), ("moved", number))
