"""Messages that the demo's subscriber received."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass
class Seen:
    """Collects the lines of ``cellwatt watch --json``."""

    samples: Counter[str] = field(default_factory=Counter)
    first: dict[str, int] = field(default_factory=dict)
    """Sequence number of the first sample received, by topic."""
    gaps: int = 0
    intervals: list[dict[str, Any]] = field(default_factory=list)
    tasks: int = 0
    predictions: int = 0
    alarms: list[dict[str, Any]] = field(default_factory=list)
    status: dict[str, Any] = field(default_factory=dict)

    def add(self, line: Mapping[str, Any]) -> None:
        """Add one line, parsed."""
        kind, content = line["kind"], line["content"]
        if kind in {"raw", "frame"}:
            self.samples[line["topic"]] += content["count"]
            self.first.setdefault(line["topic"], line["sequence"])
        elif kind == "gap":
            self.gaps += 1
        elif kind == "interval" and content["closed"]:
            self.intervals.append(content)
        elif kind == "task":
            self.tasks += 1
        elif kind == "prediction":
            self.predictions += 1
        elif kind == "alarm":
            self.alarms.append({**content, "received": line["received"]})
        elif kind == "health":
            self.status = content

    def not_up(self) -> list[str]:
        """Sources that do not deliver yet, each with its state and error."""
        if not self.status:
            return ["no health message from the daemon"]
        sources: dict[str, Any] = self.status["sources"]
        return [f"{name} is {s['state']} ({s['error']})" for name, s in sources.items() if s["state"] != "ok"]
