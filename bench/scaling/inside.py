"""One serial run in this process: what of it is spread, in how many tasks, of how many bytes.

python -m scaling.inside RECORDING...    prints it as JSON
"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cellwatt.scheduler as scheduler
from cellwatt.scheduler.parcel import pack
from scaling.product import PATIENT
from scaling.recordings import simulation_of


class Clock:
    """Stands in for ``spread``: the stages of the work, each with its tasks."""

    def __init__(self) -> None:
        self.stages: list[dict[str, Any]] = []
        self.counting = 0.0
        """s that went into counting bytes, which no run does."""

    def spread(self, function: Callable[..., Any], items: Sequence[Any], what: str, shared: Any = None) -> list[Any]:
        """See ``cellwatt.scheduler.spread``."""
        results, each = [], []
        for item in items:
            start = time.process_time()
            results.append(function(item) if shared is None else function(item, shared))
            each.append(time.process_time() - start)
        begun = time.process_time()
        sent = sum(len(pack(one)) for one in (*items, *results))
        once = 0 if shared is None else len(pack(shared))
        self.counting += time.process_time() - begun
        told = {"what": what, "tasks": len(items), "seconds": sum(each), "longest": max(each, default=0.0)}
        self.stages.append({**told, "bytes": sent, "shared": once})
        return results


def measure(recordings: Sequence[Path]) -> dict[str, Any]:
    """Seconds of computing of one serial run, and the stages that can be spread."""
    clock = Clock()
    start = time.process_time()
    scheduler.spread = clock.spread  # type: ignore[assignment]
    from cellwatt_plugins.mismatch import api  # which takes spread from there

    found = api.explain(
        recordings,
        robot=recordings[0].parent / "robot.yaml",
        simulation=[simulation_of(path) for path in recordings],
        seconds=PATIENT,
    )
    with tempfile.TemporaryDirectory() as folder:
        found.report(Path(folder) / "report.html")
    return {"seconds": time.process_time() - start - clock.counting, "stages": clock.stages}


if __name__ == "__main__":
    print(json.dumps(measure([Path(word) for word in sys.argv[1:]])))
