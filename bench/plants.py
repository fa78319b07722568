"""Two plants and headquarters over Zenoh routers: what a cut line costs, and what a limit on catching up is good for.

    python bench/plants.py [--json] [--only cut narrow past] [--hours 1] [--speed 10] [--retries 5] [--past 72]

Needs root, ``ip``, ``tc`` and ``nft``: see ``bench/plants/``. All figures are of real processes in network
namespaces.

``cut``: plant 1 is cut off for ``--hours`` of a cell whose streams are ``--speed`` times denser (500 Hz times that):
an hour at ten times speed is a cut of six minutes.
``narrow``: a cut of 15 s on a line of 1.2 MB/s, without and with ``backfill: 500 kB/s``: how late live data is.
``past``: while the line is cut the cell records ``--past`` hours of time stamps, 25 Hz, in 432 files.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from pathlib import Path
from typing import Any

from plants import network, trial

RATE = 500.0
LINE = 1.2e6
LIMIT = "500 kB/s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--only", nargs="*", default=["cut", "narrow", "past"])
    parser.add_argument("--hours", type=float, default=1.0)
    parser.add_argument("--speed", type=float, default=10.0)
    parser.add_argument("--retries", type=int, help="net.ipv4.tcp_retries2 of all machines; Linux has 15")
    parser.add_argument("--past", type=float, default=72.0)
    asked = parser.parse_args()
    if reason := network.missing():
        raise SystemExit(reason)
    found: dict[str, Any] = {}
    for name in asked.only:
        with tempfile.TemporaryDirectory() as folder:
            found |= measure(name, Path(folder), asked)
    print(json.dumps(found, indent=None if asked.json else 2))


def measure(name: str, folder: Path, asked: argparse.Namespace) -> dict[str, Any]:
    """One part of the bench, in an empty folder."""
    if name == "cut":
        seconds = 3600 * asked.hours / asked.speed
        speed = RATE * asked.speed
        return {name: trial.cut_and_catch_up(folder, seconds, speed, retries=asked.retries, patience=3600.0)}
    if name == "past":
        return {name: trial.past_and_catch_up(folder, asked.past, 25.0)}
    found = {}
    for backfill in (None, LIMIT):
        at = folder / f"{backfill is None}"
        at.mkdir()
        found[f"backfill {backfill}"] = trial.cut_and_catch_up(at, 15.0, 5 * RATE, line=LINE, backfill=backfill)
    return {name: found}


if __name__ == "__main__":
    main()
