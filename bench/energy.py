"""`cellwatt disaggregate` on arms whose true energy balance is known; none of them was used to build it.

    python bench/energy.py --json
    python bench/energy.py --arm ur_like --work out
    python bench/energy.py --as-in-the-paper --json     # 5 speeds, 30 repetitions, 2 payloads, arms like its four

Thirteen arms of six and seven joints, with torque by sensor and by current, other motors, gears, timings, rates,
noises, losses and clocks, are simulated by ``bench/energy`` (no code in common with the product) and measured as in a
campaign. Errors of groups are per cent of the run's total energy. ``docs/proof-energy.md`` holds the results.
"""

from __future__ import annotations

import argparse
import json
import tempfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from energy.arms import CASES, SPEEDS, Case
from energy.live import measure_live
from energy.product import disaggregated

GROUPS = ("electronics", "brakes", "mechanical_losses", "electrical_losses_with_regeneration", "positive_mechanical")
LIVE_GROUPS = ("mechanical_losses", "electrical_losses", "regeneration", "positive_mechanical")
LIVE_SPEED = 500.0
"""mm/s of the production task, a speed that no campaign has."""
WORTH_TELLING = 1.0
"""Percent of the total: the error of regeneration is also told as a share of itself from here on."""


PAPER = ("ur_like", "ur_big", "franka_like", "gen3_like")
"""Arms like the UR5e, UR10e, FR3 and Gen3 …"""
REPETITIONS = 30
"""… each path repeated as often as ISO 9283 has it, at the paper's five speeds (fig. 4; Gen3: four)."""


def as_in_the_paper(case: Case) -> Case:
    """The same arm measured by the paper's protocol: 50 to 250 mm/s, 30 repetitions, without and with payload."""
    speeds = SPEEDS[:4] if case.name == "gen3_like" else SPEEDS[:5]
    return replace(case, speeds=speeds, repetitions=REPETITIONS)


def measure(case: Case, work: Path) -> dict[str, Any]:
    """Simulate, disaggregate and compare one arm."""
    folder = work / case.name
    key = disaggregated(case, folder)
    found = compare(key, json.loads((folder / "out" / "energy.json").read_text()))
    return found | {"live": measure_live(case, key, folder, LIVE_SPEED, case.payload)}


def compare(key: dict[str, Any], found: dict[str, Any]) -> dict[str, Any]:
    """Errors of one arm."""
    mine = {run["run"]: run for run in found["runs"]}
    errors: dict[str, list[float]] = {name: [] for name in (*GROUPS, "total", "regeneration", "epsilon")}
    share: list[float] = []
    pulls: list[float] = []
    refused = 0
    for true in key["runs"]:
        run, total = mine[true["run"]], true["total"]
        true = true | {"electrical_losses_with_regeneration": true["electrical_losses"] + true["regeneration"]}
        for name in (*GROUPS, "total"):
            errors[name].append(100 * abs(run[name] - true[name]) / total)
            if name not in ("electronics", "brakes"):
                pulls.append(abs(run[name] - true[name]) / max(run["uncertainty"][name], 1e-4 * total))
        errors["epsilon"].append(abs(run["motion_efficiency_percent"] - 100 * true["positive_mechanical"] / total))
        if run["regeneration"] is None:
            refused += 1
            continue
        errors["regeneration"].append(100 * abs(run["regeneration"] - true["regeneration"]) / total)
        if 100 * true["regeneration"] / total > WORTH_TELLING:
            share.append(100 * abs(run["regeneration"] / true["regeneration"] - 1))
    errors["epsilon"] += _payload(key["runs"], found["payload_efficiency_percent"])
    fixed = {name: round(found["fixed"][name] - value, 3) for name, value in key["fixed"].items()}
    return {
        **{f"{name}_worst": round(max(values), 3) for name, values in errors.items() if values},
        "regeneration_error_of_itself_worst": round(max(share), 2) if share else None,
        "split_refused": refused,
        "negative_mechanical_losses": sum(run["mechanical_losses"] < 0 for run in found["runs"]),
        "fixed_error_watt": fixed,
        "errors_within_two_sigma_percent": round(100 * float(np.mean(np.array(pulls) < 2)), 1),
    }


def _payload(runs: list[dict[str, Any]], found: dict[str, float]) -> list[float]:
    empty = {run["speed"]: run["total"] for run in runs if run["payload"] == 0}
    loaded = [run for run in runs if run["payload"] > 0]
    return [abs(found[f"{r['speed']:g}"] - 100 * (r["total"] - empty[r["speed"]]) / r["total"]) for r in loaded]


def summary(arms: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """The figures that the page states."""
    return {
        "worst_group_error_percent": max(arm[f"{name}_worst"] for arm in arms.values() for name in GROUPS),
        "worst_epsilon_error_points": max(arm["epsilon_worst"] for arm in arms.values()),
        "split_error_percent": max(arm.get("regeneration_worst", 0.0) for arm in arms.values()),
        "split_error_of_itself_percent": max(arm["regeneration_error_of_itself_worst"] or 0.0 for arm in arms.values()),
        "live_balance_error_percent": max(arm["live"]["unexplained"] for arm in arms.values()),
        "live_balance_sigmas": max(arm["live"]["unexplained_sigmas"] for arm in arms.values()),
        "live_group_error_percent": max(max(arm["live"][g] for g in LIVE_GROUPS) for arm in arms.values()),
        "split_refused": sum(arm["split_refused"] for arm in arms.values()),
        "worst_fixed_error_watt": max(abs(w) for arm in arms.values() for w in arm["fixed_error_watt"].values()),
        "arms": arms,
    }


def main() -> None:
    """Run from the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--json", action="store_true", help="print all figures")
    parser.add_argument("--arm", action="append", choices=[case.name for case in CASES], help="only this arm")
    parser.add_argument("--work", type=Path, help="folder to keep the campaigns in")
    parser.add_argument("--as-in-the-paper", action="store_true", help="its speeds and repetitions; a minute an arm")
    words = parser.parse_args()
    chosen = [case for case in CASES if not words.arm or case.name in words.arm]
    if words.as_in_the_paper:
        chosen = [as_in_the_paper(case) for case in chosen if words.arm or case.name in PAPER]
    with tempfile.TemporaryDirectory() as scratch:
        figures = summary({case.name: measure(case, words.work or Path(scratch)) for case in chosen})
    print(json.dumps(figures, indent=None if words.json else 1))


if __name__ == "__main__":
    main()
