"""Figures and pictures of docs/faults-paper.md: rms by order and by rival fit, on several patterns, and Table III.

    python bench/faults/paper_fits.py [--json] [--recording FILE] [--pictures FOLDER]

A recording is a table with t, q_1 … and power of healthy cycles; the pattern of its most frequent task is added.
"""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "bench")]

from real.browser import drawn  # noqa: E402
from tests.plugins.faults.paper import irb1200  # noqa: E402
from tests.plugins.faults.paper.patterns import pattern_of  # noqa: E402

from cellwatt.emulation import ArmSignals  # noqa: E402
from cellwatt_plugins.faults.api import learn_from  # noqa: E402
from cellwatt_plugins.faults.paper.bevf import ORDERS, fit, rms  # noqa: E402
from cellwatt_plugins.faults.paper.equation import PowerEquation  # noqa: E402
from cellwatt_plugins.faults.paper.network import FaultNetwork, train  # noqa: E402
from cellwatt_plugins.faults.recordings import frames_of_files  # noqa: E402
from faults import rivals  # noqa: E402
from faults.printed import power_17  # noqa: E402
from faults.tables import PICK_AND_PLACE, POLISHING  # noqa: E402

Pattern = tuple[np.ndarray, np.ndarray]
MEASURED, FITTED, OTHER = "#9aa3ad", "#2f6fb1", "#e07b39"
SIZE = {"width": 760, "height": 300}


def patterns(recording: Path | None) -> dict[str, Pattern]:
    """Name → times s and mean power W of healthy cycles."""
    t = np.arange(0, ArmSignals().period, 1 / 123)
    demo = np.mean([ArmSignals(seed=seed).at(t)["supply.power"] for seed in range(80)], axis=0)
    found = {
        "pick-and-place": pattern_of(irb1200.PICK_AND_PLACE),
        "polishing": pattern_of(irb1200.POLISHING),
        "polishing, half speed": pattern_of(irb1200.POLISHING, speed=0.5),
        "arm of the demo": (t, demo),
    }
    return found if recording is None else found | {"recording": of_recording(recording)}


def of_recording(path: Path) -> Pattern:
    """The fastest variant of the task with most cycles: its intervals one after the other."""
    reference = learn_from(list(frames_of_files((path,))), None, None, "supply.power").reference
    variant = max((v for task in reference.tasks for v in task.variants), key=lambda v: (v.cycles, v.speed))
    step = variant.intervals[0].power.step
    parts = [i.power.at(np.arange(-min(i.rest, 0.2), i.duration + 0.1, step)) for i in variant.intervals]
    power = np.concatenate(parts)
    return np.arange(len(power)) * step, power


def compare(pattern: Pattern) -> tuple[dict[str, object], PowerEquation]:
    """What one pattern gives; the equation of the highest order."""
    t, power = pattern
    equations = {order: fit(t, power, order=order) for order in ORDERS}
    best = equations[ORDERS[-1]]
    return {
        "seconds": float(t[-1]),
        "spread_W": float(np.std(power)),
        "iterations_W": {order: equation.rms for order, equation in equations.items()},
        "rms_W": {f"BEVF {order}": rms(power, equation.power(t)) for order, equation in equations.items()}
        | {name: rms(power, curve) for name, curve in rivals.fits(t, power).items()},
        "eq_17_as_printed_W": rms(power, power_17(best.response, t)),
    }, best


def table_iii() -> dict[str, list[list[float]]]:
    """Outputs of the networks of both tables for the faults of joints 1 to 6 and for a healthy cycle."""
    return {
        name: FaultNetwork(train(table)).output_of(np.vstack([table.T, 0 * table[:, 0]])).round(3).tolist()
        for name, table in (("I", PICK_AND_PLACE), ("II", POLISHING))
    }


def chart(curves: list[tuple[str, str, np.ndarray, np.ndarray]], x_name: str, y_name: str, **y_axis: object) -> dict:
    """A figure with one line for each name, colour, x and y."""
    traces = [
        {"x": list(x), "y": list(y), "mode": "lines", "name": name, "line": {"color": colour, "width": 1.6}}
        for name, colour, x, y in curves
    ]
    titles = ({"title": {"text": text}} for text in (x_name, y_name))
    return {"data": traces, "layout": {**SIZE, "xaxis": next(titles), "yaxis": next(titles) | y_axis}}


def draw(folder: Path, pattern: Pattern, found: dict[str, object], best: PowerEquation) -> None:
    """The pattern with its fits, and rms by iteration."""
    t, power = pattern
    curves = [("mean of cycles", MEASURED, t, power), ("Gaussian 8", OTHER, t, rivals.gaussian(t, power))]
    curves.append(("BEVF, N = 44", FITTED, t, best.power(t)))
    iterations = found["iterations_W"]
    assert isinstance(iterations, dict)
    falling = [
        (f"N = {order}", colour, np.arange(1, len(values) + 1), np.asarray(values))
        for (order, values), colour in zip(iterations.items(), (MEASURED, OTHER, FITTED), strict=True)
    ]
    figures = {"pattern": chart(curves, "s", "W"), "rms": chart(falling, "iteration", "rms, W", type="log")}
    for name, svg in drawn(figures).items():
        (folder / f"faults-paper-{name}.svg").write_text(svg)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--recording", type=Path)
    parser.add_argument("--pictures", type=Path)
    asked = parser.parse_args()
    report: dict[str, object] = {}
    for name, pattern in patterns(asked.recording).items():
        found, best = compare(pattern)
        report[name] = found
        if asked.pictures and name == "pick-and-place":
            draw(asked.pictures, pattern, found, best)
    report["table_III"] = table_iii()
    if asked.json:
        print(json.dumps(report))
        return
    for name, found in report.items():
        print(name)
        rows = (
            found["rms_W"] | {k: found[k] for k in ("spread_W", "eq_17_as_printed_W")} if name != "table_III" else found
        )
        for row, value in rows.items():
            print(f"  {row:>20}  {value if name == 'table_III' else f'{value:9.3f}'}")


if __name__ == "__main__":
    main()
