"""The daemon's own alarms: a source that is down, samples that do not add up, a part that broke."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from cellwatt.results import Alarm, Severity

PATIENCE = 3
"""Looks in a row, about one a second, that must agree before an alarm is raised or cleared."""


@dataclass(frozen=True, slots=True)
class Trouble:
    """One thing that is wrong with the daemon now."""

    kind: str
    severity: Severity
    part: str
    statement: str
    evidence: Mapping[str, Any]


def troubles(status: Mapping[str, Any]) -> list[Trouble]:
    """What is wrong, seen from the health figures alone."""
    found: list[Trouble] = []
    for name, source in status["sources"].items():
        if source["state"] == "retrying":
            text = f"Source {name} is down: {source['error']}"
            found.append(Trouble("source_down", "error", name, text, {"down_s": source["since_s"]}))
        if source["residue"]:
            text = f"Source {name}: {source['residue']} samples are not accounted for."
            figures = {k: source[k] for k in ("expected", "received", "missed", "dropped")}
            found.append(Trouble("accounting", "warning", name, text, figures))
    for name, stage in status["stages"].items():
        if stage["state"] != "ok":
            found.append(Trouble("stage_broken", "error", name, f"Stage {name} broke: {stage['error']}", {}))
        if stage.get("dropped"):
            text = f"Stage {name} is too slow: {stage['dropped']} frames were dropped in front of it."
            found.append(Trouble("stage_slow", "warning", name, text, {"dropped_frames": stage["dropped"]}))
    for name, sink in status["sinks"].items():
        if sink["state"] != "ok":
            found.append(Trouble("sink_down", "warning", name, f"Sink {name} is down: {sink['error']}", {}))
    recorder = status.get("recorder")
    if recorder is not None and recorder["state"] != "ok":
        text = f"Recording is disturbed: {recorder['state']} {recorder.get('problem', '')}".rstrip()
        found.append(Trouble("recorder", "error", "recorder", text, {"refused": dict(recorder.get("drops", {}))}))
    return found


class Watch:
    """Turns what ``troubles`` finds, look by look, into alarms that are raised once and cleared once."""

    def __init__(self) -> None:
        self._seen: dict[tuple[str, str], int] = {}
        self._clean: dict[tuple[str, str], int] = {}
        self._active: dict[tuple[str, str], Alarm] = {}

    def look(self, status: Mapping[str, Any], now: int) -> list[Alarm]:
        """Alarms raised or cleared by this look; ``now`` ns UTC."""
        found = {(t.kind, t.part): t for t in troubles(status)}
        self._seen = {key: self._seen.get(key, 0) + 1 for key in found}
        alarms = [
            self._raise(key, found[key], now)
            for key, n in self._seen.items()
            if n >= PATIENCE and key not in self._active
        ]
        for key in list(self._active):
            self._clean[key] = 0 if key in found else self._clean.get(key, 0) + 1
            if self._clean[key] >= PATIENCE:
                alarm = self._active.pop(key)
                text = f"Over: {alarm.statement}"
                alarms.append(replace(alarm, active=False, time=now, statement=text))
        return alarms

    def _raise(self, key: tuple[str, str], trouble: Trouble, now: int) -> Alarm:
        kind, part = key
        source = part if kind in {"source_down", "accounting"} else None
        alarm = Alarm(
            f"{kind}:{part}",
            kind,
            trouble.severity,
            True,
            now,
            now,
            trouble.statement,
            source=source,
            evidence=trouble.evidence,
        )
        self._active[key] = alarm
        self._clean[key] = 0
        return alarm
