"""How the explainer's answers change when each of its thresholds is halved and doubled.

    python bench/concealed.py --cases 24 --make --work DIR     # makes the cases
    python bench/thresholds.py --work DIR [--json]

Thresholds are no option of the command, so that this calls the explainer itself; cases and scores are the blind
benchmark's.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from concealed.page import table
from concealed.scoring import score

from cellwatt.progress import show_progress
from cellwatt.scheduler import scheduled, spread

FACTORS = (0.5, 2.0)
LEFT_OUT = {"most"}
"""How many terms at most: a bound on time, not on belief."""


@dataclass(frozen=True)
class Job:
    """One case under one setting; ``threshold`` is empty for the setting that ships."""

    case: Path
    key: Path
    threshold: str
    factor: float


def judge(job: Job) -> dict[str, Any]:
    """Explain one case with one threshold changed."""
    from cellwatt_plugins.mismatch.explain import explain
    from cellwatt_plugins.mismatch.fit.solution import DEFAULT
    from cellwatt_plugins.mismatch.input.admission import examine
    from cellwatt_plugins.mismatch.input.reading import read_runs
    from cellwatt_plugins.robot import Arm

    thresholds = DEFAULT
    if job.threshold:
        thresholds = replace(DEFAULT, **{job.threshold: job.factor * getattr(DEFAULT, job.threshold)})
    arm = Arm.load(job.case)
    recordings = tuple(sorted(job.case.glob("run_*.recording.parquet")))
    simulations = tuple(r.with_name(r.name.replace(".recording.", ".simulation.")) for r in recordings)
    runs = read_runs(recordings, simulations, arm.description)
    base, notes = examine(runs, arm)
    found = explain(runs, base, thresholds, notes).findings.as_json()
    judged = score(json.loads(job.key.read_text()), found["findings"], [], [])
    return {
        "threshold": job.threshold,
        "factor": job.factor,
        **{k: judged[k] for k in ("exact", "hit", "false", "missed")},
    }


def jobs_of(work: Path, cases: int) -> list[Job]:
    """Every case under the setting that ships and under each change."""
    from cellwatt_plugins.mismatch.fit.solution import Thresholds

    names = [f.name for f in fields(Thresholds) if f.name not in LEFT_OUT]
    settings = [("", 1.0), *((name, factor) for name in names for factor in FACTORS)]
    folders = sorted((work / "dev").iterdir())[:cases]
    return [Job(c, work / "keys" / c.name / "key.json", name, factor) for name, factor in settings for c in folders]


def totals(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Exact sets, wrong names and misses under each setting."""
    out = []
    for setting in dict.fromkeys((r["threshold"], r["factor"]) for r in rows):
        own = [r for r in rows if (r["threshold"], r["factor"]) == setting]
        hit, false, missed = (sum(r[k] for r in own) for k in ("hit", "false", "missed"))
        out.append(
            {
                "threshold": setting[0] or "as shipped",
                "factor": setting[1],
                "exact": sum(r["exact"] for r in own),
                "cases": len(own),
                "false": false,
                "missed": missed,
                "f1": round(2 * hit / max(2 * hit + false + missed, 1), 3),
            }
        )
    return out


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", type=Path, required=True, help="folder with cases of bench/concealed.py --make")
    parser.add_argument("--cases", type=int, default=24, help="the first so many")
    parser.add_argument("--scheduler", default="local:2", help="whose workers do it, as of cellwatt's commands")
    parser.add_argument("--json", action="store_true", help="one object instead of a table")
    a = parser.parse_args()
    with show_progress(), scheduled(a.scheduler):
        rows = spread(judge, jobs_of(a.work, a.cases), "cases")
    result = totals(rows)
    if a.json:
        print(json.dumps(result))
        return
    cells = [
        [r["threshold"], f"× {r['factor']:g}", *(str(r[k]) for k in ("exact", "false", "missed", "f1"))] for r in result
    ]
    print(table(["threshold", "", f"exact of {result[0]['cases']}", "wrong names", "missed", "F1"], cells))


if __name__ == "__main__":
    main()
