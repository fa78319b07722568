"""Every figure of docs/performance.md, as one object.

    python bench/daemon.py --json [--only rtde chain …]

Runs the benchmarks of this folder one after the other, each beside its peer in one run; nothing else should run on the
machine meanwhile. The keys of the object are the names in the first column of the page's table, before the dot.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
BENCHMARKS = {
    "rtde": ("--repeats", "3", "--seconds", "5"),
    "clock": ("--seeds", "2", "--random", "50"),
    "record": ("--kills", "10"),
    "chain": ("--repeats", "2", "--seconds", "10", "--robots", "8", "32"),
    "footprint": ("--seconds", "20"),
}
"""Each benchmark with the length it has here; run alone it takes longer."""


def run(name: str) -> Any:
    """The object that one benchmark prints."""
    command = [sys.executable, str(HERE / f"{name}.py"), "--json", *BENCHMARKS[name]]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one line instead of a readable object")
    parser.add_argument("--only", nargs="+", choices=list(BENCHMARKS), default=list(BENCHMARKS), metavar="NAME")
    a = parser.parse_args()
    figures = {}
    for name in a.only:
        start = time.monotonic()
        figures[name] = run(name)
        print(f"{name}: {time.monotonic() - start:.0f} s", file=sys.stderr, flush=True)
    print(json.dumps(figures) if a.json else json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
