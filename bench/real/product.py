"""The product's commands, run as processes on files, as a user does."""

from __future__ import annotations

import json
import subprocess
import sysconfig
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

LIMIT = 3600.0
"""s that one explanation may take."""


class ExplainError(Exception):
    """A command ended with an error, or not at all; its own words."""


@dataclass(frozen=True)
class Explained:
    """What `explain` wrote, and how long it took."""

    content: dict[str, Any]
    seconds: float

    @property
    def findings(self) -> list[dict[str, Any]]:
        """Findings in the product's own order."""
        return list(self.content["findings"])

    def named(self, effect: str) -> dict[str, Any] | None:
        """The first finding of that name that the simulation lacks."""
        return next((f for f in self.findings if f["effect"] == effect and f["kind"] == "missing"), None)

    def summary(self) -> dict[str, Any]:
        """Verdict, findings with their numbers, and fit, short enough for a page."""
        return {
            "verdict": self.content["verdict"],
            "seconds": round(self.seconds, 1),
            "findings": [_short(finding) for finding in self.findings],
            "unexplained": [f"{u['channel']}: {u['statement']}" for u in self.content["unexplained"]],
            "fit": self.content["fit"],
            "model_over_floor": [round(fit["model"] / fit["noise_floor"], 2) for fit in self.content["fit"]],
            "notes": list(self.content.get("notes", [])),
        }


def explain(recordings: Sequence[Path], robot: Path, out: Path, *options: str) -> Explained:
    """Run `cellwatt explain`. Raises ``ExplainError`` with the last lines that it wrote, or that it took too long."""
    start = time.perf_counter()
    _run("explain", *map(str, recordings), "--robot", str(robot), "--out", str(out), *options)
    content = json.loads((out / "findings.json").read_text())
    return Explained(content, time.perf_counter() - start)


def simulate(model: Path, motion: Path, out: Path) -> Path:
    """Run `cellwatt simulate`; returns the table that it wrote. Raises ``ExplainError``."""
    _run("simulate", "--model", str(model), "--motion", str(motion), "--out", str(out))
    return out


def _run(*words: str) -> None:
    command = [str(Path(sysconfig.get_path("scripts")) / "cellwatt"), *words]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, check=False)
    except subprocess.TimeoutExpired as error:
        raise ExplainError(f"cellwatt {words[0]} did not end within {LIMIT:.0f} s") from error
    if done.returncode:
        raise ExplainError(f"cellwatt {words[0]}: " + " / ".join(done.stderr.strip().splitlines()[-3:]))


def _short(finding: dict[str, Any]) -> dict[str, Any]:
    parameters = {
        name: f"{p['value']:.4g} ± {p['std']:.2g} {p['unit']}".strip() for name, p in finding["parameters"].items()
    }
    return {
        "effect": finding["effect"],
        "joint": finding["joint"],
        "kind": finding["kind"],
        "confidence": round(finding["confidence"], 3),
        "parameters": parameters,
        "improvement": {k: finding["improvement"][k] for k in ("channel", "before", "after", "noise_floor")},
        "alternatives": [a["effect"] for a in finding["alternatives"]],
        "statement": finding["statement"],
    }
