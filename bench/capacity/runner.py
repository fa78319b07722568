"""The command line: which parts, how long, how often."""

from __future__ import annotations

import argparse
import json
import platform
import sys
import time
from importlib import import_module
from typing import Any

from capacity import page

PARTS = ("router", "subscribers", "record")
"""Modules of the package, each loaded when it is asked for."""


def main() -> None:
    """Measure what is asked for, print it."""
    parser = argparse.ArgumentParser(description="Capacity by measurement; docs/capacity.md says what is measured.")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, metavar="PART")
    parser.add_argument("--seconds", type=float, default=10.0, help="length of a run")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--markdown", action="store_true", help="the tables of the page instead of JSON")
    asked = parser.parse_args()
    found: dict[str, Any] = {"machine": f"{platform.machine()}, Python {platform.python_version()}"}
    for name in [name for name in PARTS if name in asked.only]:
        began = time.monotonic()
        found[name] = import_module(f"capacity.{name}").measure(asked.seconds, asked.repeats)
        print(f"{name}: {time.monotonic() - began:.0f} s", file=sys.stderr, flush=True)
    told = [f"## {name}\n\n{page.PAGES[name](found[name])}" for name in PARTS if name in found]
    print("\n\n".join(told) if asked.markdown else json.dumps(found))
