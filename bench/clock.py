"""Whether the clock model's bounds hold the true time, how wide they are, and what a call costs.

python bench/clock.py [--seeds 5] [--random 100] [--json]
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from cellwatt.clock import ClockModel

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests" / "daemon"))

from clock_worlds import EPOCH, NAMED, World, random_world, run


def named(world: World, seeds: int) -> dict[str, object]:
    """One scenario over several seeds: worst coverage, and median, lowest, highest of the bounds 10 s after start."""
    outcomes = [run(replace(world, seed=seed)) for seed in range(seeds)]

    def spread(figure: str) -> list[float]:
        values = [getattr(o, figure) * 1e3 for o in outcomes]
        return [round(float(f(values)), 4) for f in (np.median, np.min, np.max)]

    return {
        "coverage_worst": min(o.coverage for o in outcomes),
        "coverage_first_100_samples_worst": min(o.coverage_at_start for o in outcomes),
        "bound_p50_ms": spread("bound_p50"),
        "bound_p99_ms": spread("bound_p99"),
        "error_p50_ms": spread("error_p50"),
        "resets": [o.resets for o in outcomes],
        "strictly_rising": all(o.rising for o in outcomes),
    }


def at_random(worlds: int) -> dict[str, object]:
    outcomes = [run(random_world(seed)) for seed in range(worlds)]
    coverage = [o.coverage for o in outcomes]
    return {
        "worlds": worlds,
        "coverage_worst": min(coverage),
        "coverage_mean": float(np.mean(coverage)),
        "strictly_rising": all(o.rising for o in outcomes),
    }


def cost(n: int, brackets: bool) -> list[float]:
    """CPU time in µs a call of ``stamp`` with n samples at 500 Hz: median, lowest, highest of 5 runs."""
    calls = max(200, 10_000 // n)
    device = (np.arange(calls * n) * 2_000_000).reshape(calls, n)
    found = []
    for seed in range(5):
        model = ClockModel()
        delay = np.random.default_rng(seed).integers(100_000, 1_000_000, calls)
        arrivals = [EPOCH + int(a) for a in device[:, -1] + delay]
        start = time.process_time()
        for k in range(calls):
            if brackets and k * n % 500 < n:
                model.bracket(int(device[k, 0]), EPOCH + int(device[k, 0]) - 500_000)
            model.stamp(device[k], arrivals[k])
        found.append((time.process_time() - start) / calls * 1e6)
    return [round(float(f(found)), 2) for f in (np.median, np.min, np.max)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--random", type=int, default=100)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    scenarios = {world.name: named(world, options.seeds) for world in NAMED}
    scenarios["random"] = at_random(options.random)
    calls = {f"n={n}{', brackets' if b else ''}": cost(n, b) for n in (1, 10, 1000) for b in (False, True)}
    found = {"clock_model": scenarios, "stamp_cpu_us": calls, "figures": "median, lowest, highest"}
    print(json.dumps(found, indent=None if options.json else 1))


if __name__ == "__main__":
    main()
