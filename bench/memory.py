"""Whether the daemon's memory grows: each process of a typical cell, watched for as long as one likes.

    python bench/memory.py --minutes 120

A UR at 500 Hz, a power board at 123 Hz and an analyzer at 10 Hz, cut into tasks, predicted by a model, recorded and
published, and a page that is looked at in a browser, which is not counted. Every 15 s the memory is read that each
process has written and shares with none. Processes that come and go count in the sum. The slope is that of a straight
line after ``--settle`` minutes, its error twice the standard error with the correlation of neighbouring readings
counted in.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import time
from collections import defaultdict
from typing import Any

import numpy as np
from footprint import family, own, typical
from numpy.typing import NDArray

EVERY = 15.0  # s


async def watch(minutes: float, settle: float) -> dict[str, Any]:
    async with typical(shown=True) as process:
        readings = await asyncio.to_thread(_readings, process.pid, 60 * minutes)
    lasting = {part: seen for part, seen in readings.items() if len(seen) == len(readings["together"])}
    return {part: slope(np.array(seen), 60 * settle) for part, seen in lasting.items()}


def _readings(pid: int, seconds: float) -> dict[str, list[tuple[float, float]]]:
    """(s since the start, MB) by process, in the order in which these were begun, and together."""
    found: dict[str, list[tuple[float, float]]] = defaultdict(list)
    start = time.monotonic()
    while (now := time.monotonic() - start) < seconds:
        time.sleep(EVERY)
        total = 0.0
        for part in family(pid):
            try:
                size = own(part)
            except OSError:
                continue
            found[f"process {part.pid - pid}"].append((now, size))
            total += size
        found["together"].append((now, total))
    return found


def slope(seen: NDArray[np.float64], settle: float) -> dict[str, float]:
    """MB/h after ``settle`` s, with its error."""
    time_s, size = seen[seen[:, 0] >= settle].T
    hours = (time_s - time_s.mean()) / 3600
    rate = float(hours @ size / (hours @ hours))
    rest = size - size.mean() - rate * hours
    alike = float(rest[1:] @ rest[:-1] / (rest @ rest)) if rest.any() else 0.0
    fewer = np.sqrt((1 + alike) / max(1 - alike, 1e-3)) if alike > 0 else 1.0
    error = 2 * fewer * np.sqrt(rest @ rest / max(len(rest) - 2, 1) / (hours @ hours))
    return {
        "mb_first": round(float(size[0]), 2),
        "mb_last": round(float(size[-1]), 2),
        "mb_per_h": round(rate, 3),
        "error_mb_per_h": round(float(error), 3),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--settle", type=float, default=15.0, help="minutes at the start that are left out")
    given = parser.parse_args()
    print(json.dumps(asyncio.run(watch(given.minutes, given.settle))))


if __name__ == "__main__":
    main()
