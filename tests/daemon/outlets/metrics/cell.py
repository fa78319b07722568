"""A cell for the tests of its metrics: health as the daemon tells it, and an outlet that is served."""

from __future__ import annotations

from collections.abc import AsyncIterator, Mapping
from contextlib import asynccontextmanager
from typing import Any

import numpy as np

from cellwatt import Frames
from cellwatt.outlets.metrics import MetricsSettings
from cellwatt.outlets.metrics.catalogue import Family
from cellwatt.outlets.metrics.outlet import MetricsOutlet
from cellwatt.outlets.metrics.serving import Endpoint
from cellwatt.results import Energy
from tests.blocks import frames_of, layout_of
from tests.daemon.outlets.zenoh.fake_cell import EPOCH, FakeView

LAYOUT = layout_of({"arm.joint_1.position": "rad", "arm.bus.power": "W", "mains.supply.power": "W"})


def told(family: Family) -> str:
    """The name that a metric's samples have."""
    return family.name + {"counter": "_total", "info": "_info", "gauge": ""}[family.type]


def frames(*rows: tuple[float, float, float]) -> Frames:
    return frames_of(LAYOUT, 0, EPOCH + np.arange(len(rows)) * LAYOUT.step, np.array(rows))


def energy(task: str, total: float, **groups: float) -> Energy:
    return Energy("arm", task, "speed=1.00", 1, EPOCH, EPOCH + 10**9, total, groups, 1.0, 1.0, 50.0)


def source(received: int, missed: Mapping[str, int] | None = None, **more: Any) -> dict[str, Any]:
    missed = dict(missed or {})
    return {
        "state": "ok",
        "error": None,
        "expected": received + sum(missed.values()),
        "received": received,
        "missed": missed,
        "dropped": {},
        "residue": 0,
        "counters": {"event connected": 1},
        "streams": {"rtde": {"nominal_hz": 500.0, "rate_hz": 499.5, "samples": received}},
        "clocks": {"rtde": {"bound_ns": 2_500_000, "resets": 0}},
        **more,
    }


def alarm(severity: str, kind: str, acknowledged: bool = False) -> dict[str, Any]:
    known = {"name": "ada", "note": "", "time": EPOCH} if acknowledged else None
    return {"id": f"{kind}:{severity}", "severity": severity, "kind": kind, "acknowledged": known}


def health(collect: int = 101, **more: Any) -> dict[str, Any]:
    """Health of a cell; ``collect`` is the id of the process that reads the sources."""
    process = {"restarts": 0, "cpu_s": 1.5, "silent_s": 0.2, "down": False}
    return {
        "state": "green",
        "reasons": [],
        "time": EPOCH,
        "utc_error_ms": 0.5,
        "sources": {"arm": source(1000)},
        "frames": {"count": 100, "streams": {"arm/rtde": {"late": 2, "ahead": 0, "replaced": 0}}},
        "stages": {
            "faults": {
                "state": "ok",
                "failures": 0,
                "frames": 100,
                "results": 3,
                "mean_us_per_frame": 250.0,
                "slowest_ms": 4.0,
                "dropped": 0,
                "waiting": 1,
            }
        },
        "processes": {"collect": {"pid": collect, "loop_lag_ms": 0.25, **process}, "tell": {"pid": 7, **process}},
        "sinks": {"zenoh": {"state": "ok", "received": 50, "missed": {}, "dropped": {"queue": 3}, "counters": {}}},
        "recorder": {"state": "ok", "bytes": 4096, "queue": {"bytes": 10}, "flush_age": 0.1, "drops": {}},
        "results": 12,
        "alarms": [],
        "shelved": [],
        **more,
    }


def tell_everything(outlet: MetricsOutlet) -> None:
    """Tell an outlet something of which each metric is made."""
    lost = source(1000, {"gap": 4}, dropped={"checksum": 2})
    outlet.health(health(sources={'a "new"\narm': lost}, alarms=[alarm("error", "joint_fault")]))
    outlet.offer(frames((0.1, 42.5, 300.0)))
    outlet.offer(energy("task_1", 900.0, motion=600.0, rest=300.0))


def outlet_of(**settings: Any) -> MetricsOutlet:
    return MetricsOutlet("metrics", MetricsSettings(**{"listen": "127.0.0.1:0", **settings}), FakeView())


@asynccontextmanager
async def serving(outlet: MetricsOutlet) -> AsyncIterator[str]:
    """The address of the metrics, served in this process."""

    async def ask(question: Mapping[str, Any]) -> Any:
        return outlet.answer(question)

    door = Endpoint(outlet.settings, ask).door
    try:
        yield await door.start(None)
    finally:
        await door.stop()
