"""`cellwatt explain` over many recordings: one process beside workers of a local scheduler, and a law for more workers.

python bench/scale.py --work DIR [--recordings 200] [--seconds 30] [--workers 1,2] [--repeats 3] [--json | --markdown]

Recordings are made once by another physics engine (see the package `concealed`) and stay in --work. Each repeat runs
all ways in turn; findings.json and model.yaml must be the same bytes in all of them. Nothing else should run meanwhile.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from statistics import median
from typing import Any

from scaling import overheads
from scaling.law import Law
from scaling.page import markdown
from scaling.product import Measured, explain
from scaling.recordings import make

HERE = Path(__file__).resolve().parent


def ways(workers: Sequence[int]) -> dict[str, str | None]:
    """Name of each way to run it, and the scheduler that it takes."""
    return {"serial": None} | {f"local:{count}": f"local:{count}" for count in workers}


def measured(recordings: Sequence[Path], workers: Sequence[int], repeats: int) -> dict[str, list[Measured]]:
    """Runs of each way, taken in turn so that a loud minute meets all of them."""
    out: dict[str, list[Measured]] = {name: [] for name in ways(workers)}
    for _ in range(repeats):
        for name, scheduler in ways(workers).items():
            with tempfile.TemporaryDirectory() as folder:
                out[name].append(explain(recordings, scheduler, Path(folder)))
            print(f"{name}: {out[name][-1].seconds:.1f} s", file=sys.stderr, flush=True)
    return out


def inside(recordings: Sequence[Path]) -> dict[str, Any]:
    """The parts of one serial run, which a process of its own measures."""
    words = [sys.executable, "-m", "scaling.inside", *map(str, recordings)]
    paths = {"PYTHONPATH": os.pathsep.join([str(HERE), os.environ.get("PYTHONPATH", "")])}
    ended = subprocess.run(words, capture_output=True, text=True, check=True, env={**os.environ, **paths})
    return dict(json.loads(ended.stdout))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, required=True)
    parser.add_argument("--recordings", type=int, default=200)
    parser.add_argument("--seconds", type=float, default=30.0)
    parser.add_argument("--workers", default="1,2")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--markdown", action="store_true")
    given = parser.parse_args()
    workers = [int(word) for word in given.workers.split(",")]
    recordings = make(given.work / f"{given.recordings}x{given.seconds:g}s", given.recordings, given.seconds)
    runs = measured(recordings, workers, given.repeats)
    parts, costs = inside(recordings), overheads.measure(max(workers))
    law = Law.of(parts, costs)
    if "local:1" in runs:
        law = law.beside(*(median(run.seconds for run in runs[name]) for name in ("serial", "local:1")))
    same = len({run.digest for each in runs.values() for run in each}) == 1
    result = {
        "recordings": given.recordings,
        "seconds": given.seconds,
        "same_bytes": same,
        "runs": {name: [asdict(run) for run in each] for name, each in runs.items()},
        "inside": parts,
        "overheads": {**asdict(costs), "anew": law.anew},
        "law": {str(w): law.seconds(w) for w in (1, 2, 4, 8, 16, 32, 64)} | {"serial": law.seconds(None)},
    }
    print(json.dumps(result, indent=1) if given.json else markdown(result))
    if not same:
        sys.exit("findings.json or model.yaml differ between the ways")


if __name__ == "__main__":
    main()
