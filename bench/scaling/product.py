"""`cellwatt explain` as people run it, once: how long it took, how much was computed, and what it wrote."""

from __future__ import annotations

import hashlib
import json
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from scaling.recordings import simulation_of

PATIENT = 1e6
"""s of --time: what is found is not to depend on how quick the machine was."""
COMPARED = ("findings.json", "model.yaml")


@dataclass(frozen=True)
class Measured:
    """One run of the command."""

    seconds: float
    computing: float
    """s of all its processes."""
    digest: str
    """Of the files that must be the same however it was run."""
    found: tuple[str, ...]
    """Names of the effects that it found."""


def explain(recordings: Sequence[Path], scheduler: str | None, out: Path) -> Measured:
    """Run the command on recordings, with workers where ``scheduler`` names them. Raises where it fails."""
    robot = recordings[0].parent / "robot.yaml"
    words = [sys.executable, "-m", "cellwatt.commands", "explain", *map(str, recordings)]
    words += ["--simulation", *(str(simulation_of(path)) for path in recordings)]
    words += ["--robot", str(robot), "--out", str(out), "--time", str(PATIENT), "--quiet"]
    words += [] if scheduler is None else ["--scheduler", scheduler]
    before, start = _computing(), time.monotonic()
    ended = subprocess.run(words, capture_output=True, text=True)
    seconds = time.monotonic() - start
    if ended.returncode != 0:
        raise RuntimeError(f"{scheduler or 'serial'}: {ended.stderr.strip()}")
    found = json.loads((out / "findings.json").read_text())["findings"]
    digest = hashlib.sha256(b"".join((out / name).read_bytes() for name in COMPARED)).hexdigest()
    return Measured(seconds, _computing() - before, digest, tuple(f["effect"] for f in found))


def _computing() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
