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
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
BENCHMARKS = (
    "rtde", "hses", "ticker", "clock", "power_board", "record", "publish", "model", "chain", "footprint",
)  # fmt: skip


def run(name: str) -> Any:
    """The object that one benchmark prints; its last line, so that others may be progress."""
    command = [sys.executable, str(HERE / f"{name}.py"), "--json"]
    done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True)
    return json.loads(done.stdout.strip().splitlines()[-1])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one line instead of a readable object")
    parser.add_argument("--only", nargs="+", choices=BENCHMARKS, default=BENCHMARKS, metavar="NAME")
    a = parser.parse_args()
    figures = {}
    for name in a.only:
        print(f"{name} …", file=sys.stderr, flush=True)
        figures[name] = run(name)
    print(json.dumps(figures) if a.json else json.dumps(figures, indent=1))


if __name__ == "__main__":
    main()
