"""Findings of an explanation as alarms."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from cellwatt.results import Alarm, Severity
from cellwatt_plugins.explain.live.explanation import Outcome

MISMATCH = "mismatch"
FAILED = "explanation_failed"
LEFT_OUT = "effect_not_followed"

SEVERITY: Mapping[str, Severity] = {
    "no_mismatch": "info",
    "explained": "warning",
    "partly_explained": "warning",
    "unexplained": "error",
}
"""Severity by verdict; a person must look at an unknown cause."""
MOST_STATED = 3
"""Number of findings in the alarm's text; all are in its evidence."""
AGREED = "With its parameters retuned within tolerances, the simulation agrees with the recording."

Known = Collection[tuple[str, int | None]]
"""Effects of the running model, each by name and 1-based joint."""


@dataclass(frozen=True)
class Occasion:
    """Data common to all alarms of an explanation: ns of the first evidence and of the alarm, s of the recording."""

    prefix: str
    source: str
    since: int
    time: int
    seconds: float = 0.0
    gives_way: bool = True
    """True if the system permitted low priority."""

    def alarm(
        self, kind: str, severity: Severity, statement: str, evidence: Mapping[str, Any], joint: int | None = None
    ) -> Alarm:
        """An active alarm of the given kind."""
        name, since, time, source = f"{self.prefix}.{self.source}.{kind}", self.since, self.time, self.source
        return Alarm(name, kind, severity, True, since, time, statement, source, joint, evidence=evidence)


def found(occasion: Occasion, outcome: Outcome, known: Known) -> Alarm:
    """The alarm for an outcome with findings."""
    content = outcome.findings or {}
    findings: Sequence[Mapping[str, Any]] = content["findings"]
    new = [f for f in findings if (f["effect"], f["joint"]) not in known]
    joints = {f["joint"] for f in new}
    evidence = {
        "verdict": content["verdict"],
        "report": outcome.report,
        "folder": str(outcome.folder),
        "recording_s": occasion.seconds,
        "low_priority": occasion.gives_way,
        "findings": [_brief(f) | {"in_model": (f["effect"], f["joint"]) in known} for f in findings],
        "unexplained": [u["statement"] for u in content["unexplained"]],
    }
    severity, joint = SEVERITY.get(content["verdict"], "warning"), joints.pop() if len(joints) == 1 else None
    return occasion.alarm(MISMATCH, severity, _statement(new, content, bool(findings)), evidence, joint)


def failed(occasion: Occasion, reason: str, times: int) -> Alarm:
    """The alarm for an explanation that failed for the ``times``-th time in a row."""
    statement = f"Recording and simulation differ, but the explanation failed: {reason}"
    return occasion.alarm(FAILED, "warning", statement, {"failures": times, "recording_s": occasion.seconds})


def left_out(occasion: Occasion, names: Sequence[str]) -> Alarm:
    """The alarm for effects of the model that cannot be simulated live."""
    statement = (
        f"The live simulation omits {', '.join(names)} of the model: these effects depend on more of "
        "the past than the daemon knows."
    )
    return occasion.alarm(LEFT_OUT, "info", statement, {"effects": list(names)})


def _statement(new: Sequence[Mapping[str, Any]], content: Mapping[str, Any], any_at_all: bool) -> str:
    named = sorted(new, key=lambda f: (f["kind"] == "mistuned", f["effect"] == "unknown"))
    lines = [f["statement"] for f in named[:MOST_STATED]]
    if len(named) > MOST_STATED:
        lines.append(f"{len(named) - MOST_STATED} more in the report.")
    if not lines:
        lines = [u["statement"] for u in content["unexplained"][:MOST_STATED]]
    if not lines:
        lines = ["Only effects that the model already has were found: their numbers changed." if any_at_all else AGREED]
    return " ".join(lines)


def _brief(finding: Mapping[str, Any]) -> dict[str, Any]:
    brief = {k: finding[k] for k in ("effect", "joint", "kind", "confidence", "statement", "parameters")}
    return brief | {"alternatives": [a["effect"] for a in finding["alternatives"]]}
