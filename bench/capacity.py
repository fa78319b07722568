"""Capacity: cells a router, readers a cell, bytes a day, and what a year of many cells in a lake costs.

    python bench/capacity.py [--only router subscribers record lake] [--repeats 3] [--seconds 10] [--markdown]
    python bench/capacity.py --only cost --cells 1000 --price-gb-month 0.023 …

The parts are described in the modules of the package `capacity`, the figures in docs/capacity.md.
"""

import json
import sys

if __name__ == "__main__":
    if sys.argv[1:2] == ["--role"]:  # a process of the benchmark, which loads only what it needs
        from capacity.bus import role

        role(sys.argv[2], json.loads(sys.argv[3]))
    else:
        from capacity.runner import main

        main()
