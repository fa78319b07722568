"""What makes BEVF's rms fall with its order as steeply as in the paper (19.26, 6.44, 0.27 W): one cause at a time.

    python bench/faults/paper_orders.py [--json]

The arm of `tests/plugins/faults/paper/irb1200.py` runs Table I in the paper's times (5.4 s) and is measured once at
123 Hz with 1 W of noise, as in the paper; every other row changes one thing. Patterns of bells have nothing else in
them but a level.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping
from itertools import islice
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from tests.plugins.faults.paper.irb1200 import BOUNDARIES, LENGTH, PICK_AND_PLACE_AS_TIMED  # noqa: E402
from tests.plugins.faults.paper.patterns import bells, pattern_of  # noqa: E402

from cellwatt_plugins.faults.paper.bevf import ITERATIONS, ORDERS, fit, rms  # noqa: E402
from cellwatt_plugins.faults.paper.rational import iterations, starting_poles  # noqa: E402

Pattern = tuple[np.ndarray, np.ndarray]
MOTION = PICK_AND_PLACE_AS_TIMED
RATE, FINE = 123.0, 1230.0


def patterns() -> Mapping[str, Pattern]:
    """Name → times s and power W."""
    t, exact = pattern_of(MOTION, cycles=1, noise=0.0)
    fine_t, fine = pattern_of(MOTION, cycles=1, noise=0.0, rate=FINE)
    noise = np.random.default_rng(5).standard_normal(len(fine_t))
    found = {
        "as in the paper: one cycle, 123 Hz, 1 W noise": pattern_of(MOTION, cycles=1),
        "without noise": (t, exact),
        "mean of 20 cycles": pattern_of(MOTION),
    }
    for every, name in ((60, "20.5 Hz"), (72, "17.1 Hz")):
        found[f"one cycle, 1 W noise, {name}"] = (fine_t[::every], (fine + noise)[::every])
    at_ends = bells(t, BOUNDARIES, 80.0, 0.02)
    found["a peak of 80 W, 20 ms wide, at each of the five times of Fig. 9; no noise"] = (t, exact + at_ends)
    for count in (8, 12, 16, 20, 24):
        centres = np.linspace(0.2, LENGTH - 0.2, count)
        heights = np.random.default_rng(1).uniform(50, 150, count)
        found[f"{count} bells on a level"] = (t, 150 + bells(t, centres, heights, 0.03))
    return found


def errors(pattern: Pattern) -> list[float]:
    """rms (19), W, for the paper's orders."""
    t, power = pattern
    return [rms(power, fit(t, power, order=order).power(t)) for order in ORDERS]


def without_phase(pattern: Pattern) -> list[float]:
    """The same where the pattern is taken as a response of phase 0: the paper does not say where its phase is from."""
    t, power = pattern
    out = []
    for order in ORDERS:
        fits = islice(iterations(1j * t, power + 0j, starting_poles(float(t[-1]), order)), ITERATIONS)
        out.append(min(rms(power, np.abs(each.at(1j * t))) for each in fits))
    return out


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    told = patterns()
    found = {name: (len(t), float(np.std(power)), errors((t, power))) for name, (t, power) in told.items()}
    first = next(iter(told))
    found["phase 0 in place of Bode's"] = (*found[first][:2], without_phase(told[first]))
    if asked.json:
        print(json.dumps(found))
        return
    print("| pattern | points | spread, W | " + " | ".join(f"N = {order}" for order in ORDERS) + " | first / last |")
    print("|---" * 7 + "|")
    for name, (points, spread, each) in found.items():
        cells = " | ".join(f"{value:.2f}" for value in each)
        print(f"| {name} | {points} | {spread:.0f} | {cells} | {each[0] / each[-1]:.0f} |")


if __name__ == "__main__":
    main()
