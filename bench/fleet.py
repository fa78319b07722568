"""`cellwatt fleet` on emulated fleets of 50 arms over 26 weeks; what was seen while it was built: docs/fleet.md.

    python bench/fleet.py --seeds 10 --work out --json
    python bench/fleet.py --seeds 1 --arms 20 --weeks 16

Each seed is judged three times: with three joints that gain 25, 32 and 40 % of friction, with the same three gaining
10 %, and with none. The arms differ in friction, calibration, programs, payloads and halls; the half year becomes
warmer from week to week. The emulation (``bench/fleet``) has no code in common with the product.
"""

from __future__ import annotations

import argparse
import json
import pickle
import shutil
import tempfile
from dataclasses import replace
from datetime import date, timedelta
from pathlib import Path
from typing import Any

from fleet.emulated import START, Arm, fleet, write_arm, write_kinds

from cellwatt_plugins.fleet.api import compared
from cellwatt_plugins.fleet.findings import Finding, Fleet
from cellwatt_plugins.fleet.lake import Lake, find
from cellwatt_plugins.fleet.weekly import Week, week_of_cell

SMALL = 0.10
KEPT = "weeks.pickle"


def variants(seed: int, arms: int, weeks: int) -> dict[str, list[Arm]]:
    """The fleet, and the arms that wear with less of it and with none."""
    worn = fleet(seed, arms=arms, weeks=weeks)
    those = [arm for arm in worn if arm.wear]
    small = [replace(arm, wear=dict.fromkeys(arm.wear, SMALL)) for arm in those]
    return {"worn": worn, "small": small, "sound": [replace(arm, wear={}) for arm in those]}


def measured(seed: int, arms: int, weeks: int, work: Path) -> dict[str, tuple[Lake, list[Week]]]:
    """Weeks of each variant; kept in ``work`` so that judging again takes seconds."""
    kept = work / f"{seed}_{arms}_{weeks}.{KEPT}"
    if kept.exists():
        return dict(pickle.loads(kept.read_bytes()))
    out = {}
    for name, group in variants(seed, arms, weeks).items():
        folder = work / f"lake_{seed}_{name}"
        write_kinds(folder)
        for arm in group:
            write_arm(folder, arm, weeks)
        lake = find(folder)
        out[name] = (lake, [week_of_cell(item) for item in lake.weeks])
        if name != "worn" or seed > 1:
            shutil.rmtree(folder)
    kept.write_bytes(pickle.dumps(out))
    return out


def judged(seed: int, arms: int, weeks: int, work: Path) -> dict[str, Any]:
    """Compare one fleet in its three variants with the truth."""
    groups, read = variants(seed, arms, weeks), measured(seed, arms, weeks, work)
    lake, every = read["worn"]
    out: dict[str, Any] = {"seed": seed}
    for name, group in groups.items():
        truth = {arm.name: arm for arm in groups["worn"]} | {arm.name: arm for arm in group}
        changed = {arm.name for arm in group} if name != "worn" else set()
        own = [week for week in every if week.cell not in changed] + (read[name][1] if changed else [])
        out[name] = scored(compared(lake, own), truth)
    return out


def scored(found: Fleet, truth: dict[str, Arm]) -> dict[str, Any]:
    """Hits, misses and false findings of one fleet, and how far sizes are off."""
    worn = {(name, joint): rise for name, arm in truth.items() for joint, rise in arm.wear.items()}
    told = {(f.cell, f.joint): f for f in found.findings if f.what == "wears"}
    hits = {place: told[place] for place in worn if place in told}
    gears = {(n, j) for n, arm in truth.items() for j, (w, _) in arm.replaced.items() if _dropped(found, n, j, w)}
    return {
        "worn": len(worn),
        "hits": len(hits),
        "false": [f.statement for f in found.findings if not _explained(f, truth[f.cell])],
        "sizes": [[100 * worn[place], f.percent, f.low, f.high] for place, f in hits.items()],
        "new_gears": [len(gears), sum(len(arm.replaced) for arm in truth.values())],
        "smallest": dict(found.smallest),
        "courses": found.tests,
    }


def _in_week(finding: Finding, week: int) -> bool:
    return abs(date.fromisoformat(finding.first) - START.date() - timedelta(days=7 * week)) <= timedelta(days=14)


def _dropped(found: Fleet, cell: str, joint: int, week: int) -> bool:
    steps = (f for f in found.findings if f.what == "stepped_down" and (f.cell, f.joint) == (cell, joint))
    return any(_in_week(step, week) for step in steps)


def _explained(finding: Finding, arm: Arm) -> bool:
    """True where the arm really changed so; energy follows friction and payload."""
    joint = finding.joint or 0
    if finding.quantity == "friction" and joint in arm.wear:
        return finding.what == "wears"
    if finding.quantity == "friction":
        return finding.what == "stepped_down" and joint in arm.replaced and _in_week(finding, arm.replaced[joint][0])
    if finding.quantity == "energy" and (arm.wear or arm.replaced):
        return True
    return finding.what == "stepped_up" and arm.payload_from is not None and _in_week(finding, arm.payload_from)


def summary(results: list[dict[str, Any]]) -> dict[str, Any]:
    """All seeds together."""
    out: dict[str, Any] = {"fleets": len(results)}
    for name in ("worn", "small", "sound"):
        own = [result[name] for result in results]
        sizes = [size for each in own for size in each["sizes"]]
        out[name] = {
            "worn": sum(each["worn"] for each in own),
            "hits": sum(each["hits"] for each in own),
            "false": sum(len(each["false"]) for each in own),
            "mean_error_percent": sum(abs(s[1] - s[0]) for s in sizes) / len(sizes) if sizes else None,
            "within_interval": f"{sum(s[2] <= s[0] <= s[3] for s in sizes)} of {len(sizes)}",
            "new_gears": [sum(each["new_gears"][i] for each in own) for i in (0, 1)],
        }
    return out


def main() -> None:
    """Judge the seeds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--first", type=int, default=1, help="first seed")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--arms", type=int, default=50)
    parser.add_argument("--weeks", type=int, default=26)
    parser.add_argument("--work", type=Path, help="folder to keep; what was read before is not read again")
    parser.add_argument("--json", action="store_true")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as temporary:
        work = given.work or Path(temporary)
        work.mkdir(parents=True, exist_ok=True)
        results = [
            judged(seed, given.arms, given.weeks, work) for seed in range(given.first, given.first + given.seeds)
        ]
    told = {"summary": summary(results), "seeds": results}
    print(json.dumps(told if given.json else told["summary"], indent=1))


if __name__ == "__main__":
    main()
