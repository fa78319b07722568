"""The whole benchmark: draw, record, explain, score, and the two baselines beside it in the same run."""

from __future__ import annotations

import argparse
import json
import os
import shutil
import sys
import tempfile
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

from concealed import network, product, sparse
from concealed.cases import Spec, make_case, specs
from concealed.files import load_robot, load_run, load_runs
from concealed.page import markdown
from concealed.refit import refit
from concealed.scoring import Row, hold_out, residual_of, score, strength_of
from concealed.seal import REVEALED, commit, reveal
from concealed.totals import totals

OPEN = "open"
"""The seed of development runs."""
METHODS = ("explain", "sparse", "network")
TITLES = {"explain": "cellwatt explain", "sparse": "sparse regression", "network": "black-box network"}


@dataclass(frozen=True)
class Job:
    """One case to make and to judge."""

    seed: str
    index: int
    spec: Spec
    work: Path
    command: str
    methods: tuple[str, ...]
    keep: bool

    @property
    def name(self) -> str:
        """Folder of the case."""
        return f"case-{self.index + 1:03d}"


def judge(job: Job) -> Row:
    """Make one case, let every method explain it, and score the answers."""
    start = time.monotonic()
    key_file = job.work / "keys" / job.name / "key.json"
    key = (
        json.loads(key_file.read_text())
        if job.keep and key_file.exists()
        else make_case(job.seed, job.index, job.spec, job.work)
    )
    made = time.monotonic() - start
    case, sealed = job.work / "dev" / job.name, job.work / "keys" / job.name
    robot, runs = load_robot(case), load_runs(case)
    nominal = refit(robot, runs)
    tests = {
        r["run"]: load_run(sealed / f"{r['run']}.recording.parquet") for r in key["runs"] if r["split"] == "sealed"
    }
    plain = {name: nominal.left(run) for name, run in tests.items()}
    row: Row = {k: key[k] for k in ("id", "robot", "level", "run_set", "rate", "ratio", "effects")}
    row |= {"strength": strength_of(key), "seconds_to_make": round(made, 1)}
    for method in job.methods:
        start = time.monotonic()
        if method == "explain":
            row[method] = by_product(job, key, case, sealed, tests, plain)
            continue
        model = sparse.explain(robot, runs) if method == "sparse" else network.explain(robot, runs, nominal)
        seconds = time.monotonic() - start
        left = {name: model.left(run) for name, run in tests.items()}
        gaps = hold_out(key, left.get, plain.__getitem__)
        row[method] = {**score(key, model.findings, [], gaps), "seconds": round(seconds, 1), "error": None}
    return row


def by_product(job: Job, key: Row, case: Path, sealed: Path, tests: Any, plain: Any) -> Row:
    """The product's answer on one case."""
    out = job.work / "results" / job.name
    if job.keep and (out / "findings.json").exists():
        got = product.answer(out, 0.0, None)
    else:
        shutil.rmtree(out, ignore_errors=True)
        got = product.explain(job.command, case, out)

    def left(name: str) -> Any:
        predicted = product.predict(job.command, out, sealed / f"{name}.recording.parquet")
        return None if predicted is None else residual_of(tests[name], predicted)

    gaps = hold_out(key, left, plain.__getitem__)
    return {
        **score(key, got.findings, got.unexplained, gaps),
        "verdict": got.verdict,
        "seconds": round(got.seconds, 1),
        "error": got.error,
    }


def wanted(all_specs: list[Spec], only: list[str], count: int | None) -> list[int]:
    """Indices of the cases to run: by level, effect, run set or name of the case; all without a choice."""

    def fits(index: int, s: Spec) -> bool:
        words = {s.level, s.run_set, f"case-{index + 1:03d}", *(e for e, _ in s.effects)}
        return not only or bool(words & set(only))

    return [i for i, s in enumerate(all_specs) if fits(i, s)][:count]


def run(jobs: list[Job], at_once: int) -> list[Row]:
    """All jobs, some at once; progress goes to standard error, and so do cases that the benchmark itself fails at."""
    for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
        os.environ[variable] = "1"
    rows = []
    with ProcessPoolExecutor(at_once, get_context("spawn")) as pool:
        futures = {pool.submit(judge, job): job for job in jobs}
        for done in as_completed(futures):
            if (error := done.exception()) is not None:
                print(f"{futures[done].name} FAILED in the benchmark: {error!r}", file=sys.stderr, flush=True)
                continue
            row = done.result()
            rows.append(row)
            print(f"{len(rows):3d}/{len(jobs)} {progress(row)}", file=sys.stderr, flush=True)
    return sorted(rows, key=lambda r: str(r["id"]))


def progress(row: Row) -> str:
    """One line on one case, by the first method."""
    said = row[next(m for m in METHODS if m in row)]
    mark = "exact" if said["exact"] else "  -  "
    error = f" ERROR {said['error']}" if said["error"] else ""
    return f"{row['id']} {row['level']:8s} {row['robot']:15s} {mark} truth {said['truth']} named {said['named']}{error}"


def figures(rows: list[Row], methods: tuple[str, ...]) -> Row:
    """Everything that the benchmark states: the product's figures at the top, baselines beside them, the failures."""
    tops = {m: totals(rows, m) for m in methods}
    first = tops[methods[0]]
    headline = {
        k: first[k]["value"] if isinstance(first[k], dict) else first[k]
        for k in ("f1", "exact", "null_false_rate", "unknown_recall", "interval_coverage")
    }
    failures = [
        {
            "id": r["id"],
            "robot": r["robot"],
            "level": r["level"],
            "strength": r["strength"],
            "ratio": r["ratio"],
            **{k: r[methods[0]][k] for k in ("truth", "named", "unexplained", "error")},
        }
        for r in rows
        if not r[methods[0]]["exact"]
    ]
    return {
        "cases": len(rows),
        "nulls": sum(r["level"] == "null" for r in rows),
        **headline,
        "methods": tops,
        "failures": failures,
    }


def arguments() -> argparse.ArgumentParser:
    """The command line."""
    parser = argparse.ArgumentParser(prog="concealed.py", description=__doc__)
    parser.add_argument("--json", action="store_true", help="one line instead of a readable object")
    parser.add_argument("--markdown", action="store_true", help="the tables of the proof instead of an object")
    parser.add_argument("--cases", type=int, help="only the first so many of the draw")
    parser.add_argument("--only", nargs="+", default=[], metavar="WORD", help="a level, effect, run set or case-NNN")
    parser.add_argument("--jobs", type=int, default=2, help="cases at once")
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=METHODS)
    parser.add_argument("--command", default=product.default_command(), help="how to call the product")
    parser.add_argument("--work", type=Path, help="where cases and answers are kept (a temporary folder otherwise)")
    parser.add_argument("--keep", action="store_true", help="use cases and answers that are already in --work")
    parser.add_argument(
        "--seed-file",
        type=Path,
        default=REVEALED if REVEALED.exists() else None,
        help="the committed seed (default: the revealed one; before that, an open seed for development)",
    )
    parser.add_argument("--rows", type=Path, help="also write one object a case here")
    parser.add_argument("--commit", type=Path, metavar="FILE", help="draw a seed into FILE, write its digest, and stop")
    return parser


def main() -> None:
    """Entry point of `python bench/concealed.py`."""
    a = arguments().parse_args()
    if a.commit:
        print(commit(a.commit))
        return
    seed, salt, sealed = reveal(a.seed_file) if a.seed_file else (OPEN, "", False)
    with tempfile.TemporaryDirectory(prefix="concealed-") as temporary:
        work = a.work or Path(temporary)
        all_specs = specs(seed)
        methods = tuple(m for m in METHODS if m in a.methods)
        jobs = [
            Job(seed, i, all_specs[i], work, a.command, methods, a.keep) for i in wanted(all_specs, a.only, a.cases)
        ]
        rows = run(jobs, a.jobs)
    result = {"seed": seed, "salt": salt, "seed_was_committed": sealed, **figures(rows, methods)}
    if a.rows:
        a.rows.write_text(json.dumps(rows, indent=1))
    if a.markdown:
        print(markdown(result, TITLES))
    else:
        print(json.dumps(result) if a.json else json.dumps(result, indent=1))
    if len(rows) < len(jobs):
        raise SystemExit(f"{len(jobs) - len(rows)} cases are not in these figures: the benchmark failed at them")
