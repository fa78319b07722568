"""How late deadlines are served: cellwatt's tickers beside plain asyncio.sleep deadline loops, in one run.

python bench/ticker.py [--seconds 10] [--runs 5] [--json]
"""

from __future__ import annotations

import argparse
import asyncio
import json
import platform
import time
from collections.abc import Awaitable, Callable

import numpy as np

from cellwatt.ticker import Ticker

CASES = {"64 x 50 Hz": (64, 50.0), "1 x 500 Hz": (1, 500.0)}
FIGURES = ("p50_ms", "p99_ms", "p99.9_ms", "max_ms", "merged", "cpu_percent")


async def ticker_loop(rate: float, end: int, k: int, late: list[int]) -> int:
    merged = 0
    async with Ticker(rate) as ticker:
        async for beat in ticker:
            late.append(time.monotonic_ns() - beat.deadline)
            merged += beat.merged
            if beat.deadline >= end:
                return merged
    raise AssertionError


async def sleep_loop(rate: float, end: int, k: int, late: list[int]) -> int:
    """A deadline loop as it is usually written; phases are spread as the tickers' are."""
    period = round(1e9 / rate)
    deadline = time.monotonic_ns() + round(min(period, 20e6) * (k * 0.6180339887 % 1))
    merged = 0
    while True:
        await asyncio.sleep((deadline - time.monotonic_ns()) / 1e9)
        now = time.monotonic_ns()
        missed = max(0, (now - deadline) // period)
        merged += missed
        deadline += missed * period
        late.append(now - deadline)
        if deadline >= end:
            return merged
        deadline += period


async def serve(loop: Callable[..., Awaitable[int]], tasks: int, rate: float, seconds: float) -> dict[str, float]:
    late: list[int] = []
    end = time.monotonic_ns() + round(seconds * 1e9)
    cpu = time.process_time()
    merged = await asyncio.gather(*(loop(rate, end, k, late) for k in range(tasks)))
    cpu = time.process_time() - cpu
    ms = np.percentile(late, [50, 99, 99.9, 100]) / 1e6
    return dict(zip(FIGURES, [*ms.tolist(), sum(merged), 100 * cpu / seconds], strict=True))


def measure(seconds: float, runs: int) -> dict[str, dict[str, dict[str, list[float]]]]:
    """Case → method → figure → [median, lowest, highest] over the runs, which alternate between the methods."""
    found: dict[str, dict[str, dict[str, list[float]]]] = {}
    for case, (tasks, rate) in CASES.items():
        results: dict[str, list[dict[str, float]]] = {"cellwatt": [], "asyncio.sleep": []}
        for _ in range(runs):
            for method, loop in (("cellwatt", ticker_loop), ("asyncio.sleep", sleep_loop)):
                results[method].append(asyncio.run(serve(loop, tasks, rate, seconds)))
        found[case] = {
            method: {
                name: [round(float(f([r[name] for r in rows])), 4) for f in (np.median, np.min, np.max)]
                for name in FIGURES
            }
            for method, rows in results.items()
        }
    return found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--runs", type=int, default=5)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    found = measure(options.seconds, options.runs)
    if options.json:
        setting = {"seconds": options.seconds, "runs": options.runs, "python": platform.python_version()}
        print(json.dumps({"lateness": found, "figures": "median, lowest, highest of the runs", "setting": setting}))
        return
    for case, methods in found.items():
        for method, figures in methods.items():
            text = "  ".join(f"{name} {m:.3f} ({lo:.3f} … {hi:.3f})" for name, (m, lo, hi) in figures.items())
            print(f"{case:12s} {method:14s} {text}")


if __name__ == "__main__":
    main()
