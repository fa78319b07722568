"""The product as a process: `explain` on the open runs of a case, `simulate` on the sealed motions."""

from __future__ import annotations

import json
import os
import shlex
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from concealed.arms import Array

LIMIT = 300.0
"""Seconds that a call may take, on a machine that does nothing else."""


STOPS = (signal.SIGINT, signal.SIGTERM, signal.SIGKILL)


class StoppedError(RuntimeError):
    """A call was stopped from outside: that is no answer of the product."""


def default_command() -> str:
    """`cellwatt` of the environment that runs the benchmark."""
    return str(Path(sys.executable).with_name("cellwatt"))


def call(words: list[str], limit: float) -> str | None:
    """Run one command on one thread; what went wrong, or None. Raises StoppedError where somebody stopped it."""
    threads = {f"{lib}_NUM_THREADS": "1" for lib in ("OMP", "OPENBLAS", "MKL")}
    try:
        done = subprocess.run(words, capture_output=True, text=True, timeout=limit, env={**os.environ, **threads})
    except subprocess.TimeoutExpired:
        return f"no answer in {limit:.0f} s"
    except OSError as broken:
        return str(broken)
    if -done.returncode in STOPS:
        raise StoppedError(f"{words[-1]}: stopped by signal {-done.returncode}")
    return None if done.returncode == 0 else (done.stderr or done.stdout).strip()[-300:]


@dataclass(frozen=True)
class Answer:
    """What `explain` wrote, how long it took, and what went wrong."""

    findings: list[dict[str, Any]]
    unexplained: list[dict[str, Any]]
    verdict: str | None
    seconds: float
    error: str | None


def explain_words(command: str, case: Path, out: Path) -> list[str]:
    """The command that explains all open runs of one case."""
    runs = sorted(case.glob("run_*.recording.parquet"))
    simulation = [r.with_name(r.name.replace(".recording.", ".simulation.")) for r in runs]
    words = [*shlex.split(command), "explain", *map(str, runs), "--simulation", *map(str, simulation)]
    return [*words, "--robot", str(case / "robot.yaml"), "--out", str(out)]


def explain(command: str, case: Path, out: Path, limit: float = LIMIT) -> Answer:
    """Run `explain` on all open runs of one case."""
    words = explain_words(command, case, out)
    out.mkdir(parents=True, exist_ok=True)
    start = time.monotonic()
    error = call(words, limit)
    return answer(out, time.monotonic() - start, error)


def answer(out: Path, seconds: float, error: str | None) -> Answer:
    """Read what `explain` wrote."""
    try:
        found = json.loads((out / "findings.json").read_text())
        named = [(f["effect"], f["joint"], f["kind"]) for f in found["findings"]]
        if not all(kind in ("missing", "structure", "mistuned") for _, _, kind in named):
            raise ValueError(named)
        return Answer(found["findings"], found.get("unexplained", []), found.get("verdict"), seconds, error)
    except (OSError, ValueError, KeyError, TypeError) as broken:
        return Answer([], [], None, seconds, error or f"findings.json: {broken!r}")


def motion_of(recording: Path, simulation: Path, source: str) -> pa.Table:
    """What is asked for: the planned motion, or the recorded positions and velocities; never torque or power."""
    seen, plan = pq.read_table(recording), pq.read_table(simulation)
    motion = plan.drop_columns([c for c in plan.column_names if c.startswith("tau_") or c == "power"])
    if source == "recorded":
        motion = seen.select(["t", *(c for c in seen.column_names if c.startswith(("q_", "qd_")))])
    for column in (c for c in seen.column_names if c.startswith("temperature_")):
        motion = motion.append_column(column, seen[column])
    return motion


def predict(
    command: str, out: Path, recording: Path, source: str = "planned", limit: float = LIMIT
) -> tuple[Array, Array] | None:
    """Torque (N, n) and power (N,) of the product's model for a sealed motion, "planned" or "recorded".

    It is given the user's simulation of that motion, and never sees the answer. None where there is no prediction for
    every sample of the motion.
    """
    name = recording.name.split(".")[0]
    simulation, own = (recording.with_name(f"{name}.{what}.parquet") for what in ("simulation", "simulator"))
    motion, result = out / f"{name}.{source}.parquet", out / f"{name}.{source}.prediction.parquet"
    asked = motion_of(recording, simulation, source)
    pq.write_table(asked, motion)
    result.unlink(missing_ok=True)
    words = [*shlex.split(command), "simulate", "--model", str(out / "model.yaml")]
    words += ["--motion", str(motion), "--out", str(result), "--simulation", str(own if own.exists() else simulation)]
    if call(words, limit) is not None or not result.exists():
        return None
    table = pq.read_table(result)
    if len(table) != len(asked):
        return None
    n = sum(c.startswith("tau_") for c in table.column_names)
    torque = np.stack([table[f"tau_{j + 1}"].to_numpy() for j in range(n)], axis=1).astype(float)
    return torque, table["power"].to_numpy().astype(float)
