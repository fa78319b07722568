"""Every driver beside the plain loop of the library that speaks its protocol, as one object.

    python bench/drivers.py --json [--only abb franka …] [--seconds 5] [--repeats 3]

Samples a second, samples lost and share of one core, of both sides in turns at the same emulated devices. Runs the
benchmarks of the folder ``drivers`` beside this file, and those of this folder for the drivers that have one there, one
after the other; nothing else should run on the machine meanwhile. Without --json it prints the table of
``docs/performance.md``. A benchmark that fails or hangs is told, and the others go on.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
IN_TURNS = ("abb", "franka", "kinova", "modbus_meter", "can_sensor", "scpi_analyzer", "opc_ua")
"""Benchmarks that ``drivers/sides.py`` runs: all have one shape."""
OWN = {"ur": "rtde", "yaskawa": "hses", "power_board": "power_board"}
"""Benchmarks with more to tell than that, by driver."""
LONGEST = 900.0
"""s that one benchmark may take at most."""
REPEATS = {"rtde": "--repeats", "hses": "--repeats", "power_board": "--rounds"}
HEAD = ("driver", "devices × rate", "library", "samples/s", "lost", "share of a core", "late p99, ms")


def run(driver: str, seconds: float, repeats: int) -> Any:
    """The object that one benchmark prints; ``None`` where it fails, with the reason on standard error."""
    own = OWN.get(driver)
    file = HERE / (f"{own}.py" if own else f"drivers/{driver}.py")
    length = [REPEATS.get(own or "", "--repeats"), str(repeats)]
    if own != "power_board":
        length += ["--seconds", f"{seconds:g}"]
    command = [sys.executable, str(file), "--json", *length]
    try:
        done = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True, timeout=LONGEST)
    except (subprocess.CalledProcessError, subprocess.TimeoutExpired) as error:
        print(f"{driver}: {error}", file=sys.stderr)
        return None
    return json.loads(done.stdout)


def table(figures: dict[str, Any]) -> str:
    """The benchmarks that have one shape, as Markdown: ours, then the plain loop."""
    lines = [f"| {' | '.join(HEAD)} |", "|---" * len(HEAD) + "|"]
    for driver, found in figures.items():
        if driver in OWN or found is None:
            continue
        ours, plain = found["cellwatt"], found["plain"]
        late = " · ".join("–" if side["late"] is None else _spread(side["late"]["p99_ms"]) for side in (ours, plain))
        cells = (
            f"`{driver}`",
            f"{found['devices']} × {found['rate']:g} Hz",
            found["library"],
            f"{ours['samples_per_second']['median']:.0f} · {plain['samples_per_second']['median']:.0f}",
            f"{ours['lost']} · {plain['lost']}",
            f"{_spread(ours['cpu_share'], 100)} % · {_spread(plain['cpu_share'], 100)} %",
            late,
        )
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _spread(spread: dict[str, float], factor: float = 1.0) -> str:
    median, lowest, highest = (factor * spread[name] for name in ("median", "lowest", "highest"))
    return f"{median:.1f} ({lowest:.1f} … {highest:.1f})"


def main() -> None:
    names = [*IN_TURNS, *OWN]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="one object instead of a table")
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="DRIVER")
    parser.add_argument("--seconds", type=float, default=5.0, help="measured time of each run")
    parser.add_argument("--repeats", type=int, default=3)
    given = parser.parse_args()
    figures = {driver: run(driver, given.seconds, given.repeats) for driver in given.only}
    if given.json:
        print(json.dumps(figures))
    else:
        print(table(figures))
        for driver in (d for d in figures if d in OWN):
            print(f"\n{driver}: {json.dumps(figures[driver], indent=1)}")
    if None in figures.values():
        sys.exit(1)


if __name__ == "__main__":
    main()
