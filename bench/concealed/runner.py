"""The whole benchmark: draw, record, explain, score; it goes on where it was stopped, and splits its figures."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from cellwatt.progress import show_progress
from cellwatt.scheduler import scheduled, spread
from concealed import kept, product
from concealed.cases import Spec, specs
from concealed.judging import MOTIONS, Codes, Job, judge, make
from concealed.page import markdown
from concealed.scoring import Row
from concealed.seal import REVEALED, commit, reveal
from concealed.totals import totals

OPEN = "open"
"""The seed of development runs."""


def wanted(all_specs: list[Spec], only: list[str], count: int | None) -> list[int]:
    """Indices of the cases to run: by level, effect, run set, simulation, loop or name; all without a choice."""

    def fits(index: int, s: Spec) -> bool:
        loop, whose = "soft" if s.soft else "stiff", "law" if s.simulation == "law" else "own"
        words = {s.level, s.run_set, s.simulation, whose, loop, f"case-{index + 1:03d}", *(e for e, _ in s.effects)}
        return not only or bool(words & set(only))

    return [i for i, s in enumerate(all_specs) if fits(i, s)][:count]


def attempted(step: Callable[[Job], Row], jobs: list[Job]) -> list[tuple[Job, Row]]:
    """Each job with its result; cases that the benchmark itself fails at are said and left out."""
    rows = spread(attempt, [(step, job) for job in jobs], "cases")
    return [(job, row) for job, row in zip(jobs, rows, strict=True) if row is not None]


def attempt(work: tuple[Callable[[Job], Row], Job]) -> Row | None:
    """The result of one job; None where the benchmark fails at it."""
    step, job = work
    try:
        row = step(job)
    except Exception as error:
        say(f"{job.name} FAILED in the benchmark: {error!r}")
        return None
    say(f"{job.name} {progress(job, row)}")
    return row


def say(line: str) -> None:
    """Progress goes to standard error."""
    print(line, file=sys.stderr, flush=True)


def progress(job: Job, row: Row) -> str:
    """One line on one case; where it is only made, how long that took."""
    head = f"{job.spec.level:7s} {job.spec.simulation:5s} {row['robot']:14s}"
    if "exact" not in row:
        return f"{head} made in {row['seconds_to_make']:.0f} s"
    mark = "exact" if row["exact"] else "  -  "
    error = f" ERROR {row['error']}" if row["error"] else ""
    return f"{head} {mark} truth {row['truth']} named {row['named']}{error}"


def run(jobs: list[Job]) -> list[Row]:
    """Scores of all jobs, of which those that are kept from an earlier run are not done again."""
    rows = {job.name: kept.read(*job.scored) for job in jobs}
    rest = [job for job in jobs if rows[job.name] is None]
    if len(rest) < len(jobs):
        say(f"{len(jobs) - len(rest)} of {len(jobs)} cases are kept from before")
    rows |= {job.name: row for job, row in attempted(judge, rest)}
    return [row for _, row in sorted(rows.items()) if row is not None]


def others(jobs: list[Job]) -> int:
    """How many answers that are kept belong to another seed, product or benchmark than these jobs'."""
    return sum(job.answered[0].exists() and kept.read(*job.answered) is None for job in jobs)


FAILURE = ("id", "robot", "level", "strength", "ratio", "truth", "named", "unexplained", "error")
"""What is told of a case that was not exact."""


def figures(rows: list[Row]) -> Row:
    """Everything that the benchmark states: the figures at the top, then the failures."""
    every = totals(rows)
    headline = {
        k: every[k]["value"] if isinstance(every[k], dict) else every[k]
        for k in ("f1", "exact", "null_false_rate", "unknown_recall", "interval_coverage")
    }
    failures = [{"simulation": r["simulation"]["kind"], **{k: r[k] for k in FAILURE}} for r in rows if not r["exact"]]
    nulls = sum(r["level"] == "null" for r in rows)
    return {"cases": len(rows), "nulls": nulls, **headline, "totals": every, "failures": failures}


def arguments() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(prog="concealed.py", description=__doc__)
    parser.add_argument("--json", action="store_true", help="one line instead of a readable object")
    parser.add_argument("--markdown", action="store_true", help="the tables of the proof instead of an object")
    parser.add_argument("--cases", type=int, help="only the first so many of the draw")
    parser.add_argument(
        "--only",
        nargs="+",
        default=[],
        metavar="WORD",
        help="a level, effect, run set, kind of simulation, soft, stiff or case-NNN",
    )
    parser.add_argument("--jobs", type=int, default=2, help="cases at once: --scheduler local:N in short")
    parser.add_argument("--scheduler", metavar="PLACE", help="whose workers do the cases, as of cellwatt's commands")
    parser.add_argument("--stiff", action="store_true", help="no controller is soft, as in the first four runs")
    parser.add_argument(
        "--motions",
        nargs="+",
        default=["planned"],
        choices=MOTIONS,
        help="which motions of the sealed runs are predicted",
    )
    parser.add_argument("--command", default=product.default_command(), help="how to call the product")
    parser.add_argument(
        "--limit", type=float, default=product.LIMIT, help="seconds that a call of the product may take"
    )
    parser.add_argument(
        "--work", type=Path, help="where cases, answers and scores are kept to go on from (otherwise they are not)"
    )
    parser.add_argument("--make", action="store_true", help="only make the cases in --work, and stop")
    parser.add_argument(
        "--again", action="store_true", help="replace answers in --work by other code or of another seed"
    )
    parser.add_argument(
        "--seed-file",
        type=Path,
        default=REVEALED if REVEALED.exists() else None,
        help="the committed seed (default: the revealed one; before that, an open seed for development)",
    )
    parser.add_argument("--rows", type=Path, help="also write one object a case here")
    parser.add_argument("--commit", type=Path, metavar="FILE", help="draw a seed into FILE, write its digest, and stop")
    return parser


def jobs_of(a: argparse.Namespace, seed: str, work: Path) -> list[Job]:
    """What the command line asks for."""
    all_specs = [replace(s, soft=s.soft and not a.stiff) for s in specs(seed)]
    codes = Codes(kept.making(), kept.product(), kept.judging())
    return [
        Job(seed, i, all_specs[i], work, a.command, codes, a.limit, tuple(a.motions))
        for i in wanted(all_specs, a.only, a.cases)
    ]


def place(a: argparse.Namespace) -> str | None:
    """The scheduler that the command line asks for; None where cases are done here, one after the other."""
    return a.scheduler or (f"local:{a.jobs}" if a.jobs > 1 else None)


def main() -> None:
    """Entry point of `python bench/concealed.py`."""
    parser = arguments()
    a = parser.parse_args()
    if a.commit:
        print(commit(a.commit))
        return
    if a.make and not a.work:
        parser.error("--make needs --work, where the cases are kept")
    seed, salt, sealed = reveal(a.seed_file) if a.seed_file else (OPEN, "", False)
    with tempfile.TemporaryDirectory(prefix="concealed-") as temporary:
        jobs = jobs_of(a, seed, a.work or Path(temporary))
        if a.make:
            with show_progress(), scheduled(place(a)):
                say(f"{len(attempted(make, jobs))} of {len(jobs)} cases are in {a.work}")
            return
        if (old := others(jobs)) and not a.again:
            parser.error(
                f"{old} answers in {a.work} are of another seed or of other code than now: give another --work, "
                "or --again to replace them"
            )
        with show_progress(), scheduled(place(a)):
            rows = run(jobs)
    result = {"seed": seed, "salt": salt, "seed_was_committed": sealed, "code": jobs[0].codes.product if jobs else None}
    result |= figures(rows)
    if a.rows:
        a.rows.write_text(json.dumps(rows, indent=1))
    if a.markdown:
        print(markdown(result))
    else:
        print(json.dumps(result) if a.json else json.dumps(result, indent=1))
    if len(rows) < len(jobs):
        raise SystemExit(f"{len(jobs) - len(rows)} cases are not in these figures: the benchmark failed at them")
