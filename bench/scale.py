"""`cellwatt explain` over many recordings: one process beside workers of this machine.

python bench/scale.py --work DIR [--recordings 200] [--seconds 30] [--workers 1,2] [--repeats 3] [--json]

Recordings are made once by another physics engine (see the package `concealed`) and stay in --work. Each repeat runs
all ways in turn, so that a loud minute meets all of them; findings.json and model.yaml must be the same bytes in all.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from statistics import median

from scaling.product import Measured, explain
from scaling.recordings import make


def measured(recordings: Sequence[Path], workers: Sequence[int], repeats: int) -> dict[str, list[Measured]]:
    """Runs without workers ("serial") and with each number of them."""
    ways = {"serial": None} | {f"local:{count}": f"local:{count}" for count in workers}
    out: dict[str, list[Measured]] = {name: [] for name in ways}
    for _ in range(repeats):
        for name, scheduler in ways.items():
            with tempfile.TemporaryDirectory() as folder:
                out[name].append(explain(recordings, scheduler, Path(folder)))
            print(f"{name}: {out[name][-1].seconds:.1f} s", file=sys.stderr, flush=True)
    return out


def table(runs: Mapping[str, Sequence[Measured]]) -> str:
    """Medians as Markdown, with the range of the time."""
    serial = median(run.seconds for run in runs["serial"])
    lines = [
        "| way | s (lowest … highest) | s of computing | times as fast as serial | found |",
        "|---|---|---|---|---|",
    ]
    for name, each in runs.items():
        seconds = sorted(run.seconds for run in each)
        computing, found = median(run.computing for run in each), ", ".join(each[-1].found)
        told = f"{median(seconds):.1f} ({seconds[0]:.1f} … {seconds[-1]:.1f})"
        lines.append(f"| {name} | {told} | {computing:.1f} | {serial / median(seconds):.2f} | {found} |")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--recordings", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--workers", default="1,2")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    workers = [int(word) for word in given.workers.split(",")]
    recordings = make(given.work / f"{given.recordings}x{given.seconds:g}s", given.recordings, given.seconds)
    runs = measured(recordings, workers, given.repeats)
    as_json = {name: [asdict(run) for run in each] for name, each in runs.items()}
    print(json.dumps(as_json) if given.json else table(runs))
    if len({run.digest for each in runs.values() for run in each}) > 1:
        sys.exit("findings.json or model.yaml differ between the ways")


if __name__ == "__main__":
    main()
