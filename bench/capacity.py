"""Capacity: cells a router, readers a cell, bytes a day.

    python bench/capacity.py [--only router subscribers record] [--repeats 3] [--seconds 10] [--markdown]

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
