"""One case from draw to scores; each step is skipped where its result is kept."""

from __future__ import annotations

import shutil
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from concealed import kept, product
from concealed.cases import Spec, make_case
from concealed.files import Run, load_run
from concealed.product import Answer
from concealed.scoring import Row, hold_out, predictable, residual_of, score, strength_of

MOTIONS = ("planned", "recorded")
"""What the prediction of a sealed run may be asked for."""
FIELDS = ("id", "robot", "level", "simulation", "run_set", "rate", "ratio", "effects")


@dataclass(frozen=True)
class Codes:
    """Digests of the code that a result depends on."""

    making: str
    product: str
    judging: str


@dataclass(frozen=True)
class Job:
    """One case to make and to judge."""

    seed: str
    index: int
    spec: Spec
    work: Path
    command: str
    codes: Codes
    limit: float = product.LIMIT
    motions: tuple[str, ...] = ("planned",)

    @property
    def name(self) -> str:
        """Folder of the case."""
        return f"case-{self.index + 1:03d}"

    @property
    def made(self) -> tuple[Path, str]:
        """File and stamp of the case once it is made."""
        return self.work / "made" / f"{self.name}.json", kept.stamp(self.seed, self.index, self.spec, self.codes.making)

    @property
    def answered(self) -> tuple[Path, str]:
        """File and stamp of the product's answer."""
        stamp = kept.stamp(self.made[1], self.command, self.codes.product)
        return self.work / "answers" / f"{self.name}.json", stamp

    @property
    def scored(self) -> tuple[Path, str]:
        """File and stamp of the case's scores."""
        stamp = kept.stamp(self.answered[1], self.motions, self.codes.judging)
        return self.work / "rows" / f"{self.name}.json", stamp


def make(job: Job) -> Row:
    """The case's key; its files are made where they are not there."""
    if (key := kept.read(*job.made)) is None:
        start = time.monotonic()
        for folder in ("dev", "keys", "results"):
            shutil.rmtree(job.work / folder / job.name, ignore_errors=True)
        key = make_case(job.seed, job.index, job.spec, job.work)
        key["seconds_to_make"] = round(time.monotonic() - start, 1)
        kept.keep(*job.made, key)
    return dict(key)


def answer(job: Job) -> Answer:
    """The product's answer on one case."""
    if (old := kept.read(*job.answered)) is not None:
        return Answer(**old)
    out = job.work / "results" / job.name
    shutil.rmtree(out, ignore_errors=True)
    got = product.explain(job.command, job.work / "dev" / job.name, out, job.limit)
    kept.keep(*job.answered, asdict(got))
    return got


def judge(job: Job) -> Row:
    """Make one case, let the product explain it, and score its findings and its model on the sealed runs."""
    if (old := kept.read(*job.scored)) is not None:
        return dict(old)
    key, got = make(job), answer(job)
    out, sealed = job.work / "results" / job.name, job.work / "keys" / job.name
    tests: dict[str, Run] = {}

    def left_of(source: str) -> Any:
        def left(name: str) -> Any:
            recording = sealed / f"{name}.recording.parquet"
            predicted = product.predict(job.command, out, recording, source, job.limit)
            if predicted is None:
                return None
            if name not in tests:
                tests[name] = load_run(recording, sealed)
            return residual_of(tests[name], predicted)

        return left

    sources = job.motions if predictable(key) else ()
    gaps = {source: hold_out(key, left_of(source)) for source in sources}
    row: Row = {k: key[k] for k in FIELDS} | {"strength": strength_of(key), "seconds_to_make": key["seconds_to_make"]}
    row |= {
        **score(key, got.findings, got.unexplained, gaps.get("planned", [])),
        "hold_out_recorded": gaps.get("recorded", []),
        "verdict": got.verdict,
        "seconds": round(got.seconds, 1),
        "error": got.error,
    }
    kept.keep(*job.scored, row)
    return row
