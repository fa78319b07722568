"""Values of metrics, read from the health that the daemon tells. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

Body = Mapping[str, Any]
STATES: Final = ("green", "amber", "red")


class Reading(NamedTuple):
    """Value of one series; ``metric`` is a name of the catalogue without ``cellwatt_``, ``labels`` in its order.

    ``part`` names what counts, where its count may be taken back; see ``Lives``.
    """

    metric: str
    labels: tuple[str, ...]
    value: float
    part: str | None = None


def of_health(status: Body) -> Iterator[Reading]:
    """All that a health message tells."""
    for state in STATES:
        yield Reading("state", (state,), float(status.get("state") == state))
    yield Reading("utc_error_seconds", (), 1e-3 * status.get("utc_error_ms", 0.0))
    yield Reading("results", (), status.get("results", 0))
    for name, source in status.get("sources", {}).items():
        yield from _of_source(name, source)
    yield from _of_frames(status.get("frames", {}))
    for name, stage in status.get("stages", {}).items():
        yield from _of_stage(name, stage)
    for name, outlet in status.get("sinks", {}).items():
        yield Reading("sink_up", (name,), float(outlet["state"] == "ok"))
        yield from _of_account("sink", "sink_occurrences", f"outlet {name}", name, outlet)
    for name, process in status.get("processes", {}).items():
        yield from _of_process(name, process)
    if (recorder := status.get("recorder")) is not None:
        yield from _of_recorder(recorder)
    yield from _of_alarms(status)


def _of_source(name: str, source: Body) -> Iterator[Reading]:
    yield Reading("source_up", (name,), float(source["state"] == "ok"))
    yield Reading("samples_expected", (name,), source.get("expected", 0))
    yield Reading("samples_unaccounted", (name,), source.get("residue", 0))
    yield from _of_account("samples", "source_occurrences", f"source {name}", name, source)
    for stream, figures in source.get("streams", {}).items():
        yield Reading("stream_nominal_hertz", (name, stream), figures["nominal_hz"] or 0.0)
        if figures["rate_hz"] is not None:
            yield Reading("stream_rate_hertz", (name, stream), figures["rate_hz"])
    for stream, clock in source.get("clocks", {}).items():
        yield Reading("clock_bound_seconds", (name, stream), 1e-9 * clock["bound_ns"])
        yield Reading("clock_resets", (name, stream), clock["resets"])


def _of_account(kind: str, other: str, part: str, name: str, account: Body) -> Iterator[Reading]:
    yield Reading(f"{kind}_received", (name,), account.get("received", 0))
    lost = sum(account.get("missed", {}).values()) + sum(account.get("dropped", {}).values())
    yield Reading(f"{kind}_lost", (name,), lost, part)
    for reason, n in account.get("missed", {}).items():
        yield Reading(f"{kind}_missed", (name, reason), n, part)
    for where, n in account.get("dropped", {}).items():
        yield Reading(f"{kind}_dropped", (name, where), n)
    for what, n in account.get("counters", {}).items():
        yield Reading(other, (name, what), n)


def _of_frames(frames: Body) -> Iterator[Reading]:
    yield Reading("frames", (), frames.get("count", 0))
    for stream, counts in frames.get("streams", {}).items():
        for reason, n in counts.items():
            yield Reading("frame_samples_unused", (stream, reason), n)


def _of_stage(name: str, stage: Body) -> Iterator[Reading]:
    label = (name,)
    yield Reading("stage_up", label, float(stage["state"] == "ok"))
    for figure in ("frames", "results", "failures"):
        yield Reading(f"stage_{figure}", label, stage.get(figure, 0))
    yield Reading("stage_frames_dropped", label, stage.get("dropped", 0))
    yield Reading("stage_frames_waiting", label, stage.get("waiting", 0))
    if stage.get("mean_us_per_frame") is not None:
        yield Reading("stage_mean_seconds", label, 1e-6 * stage["mean_us_per_frame"])
    yield Reading("stage_slowest_seconds", label, 1e-3 * stage.get("slowest_ms", 0.0))


def _of_process(name: str, process: Body) -> Iterator[Reading]:
    label = (name,)
    yield Reading("process_up", label, float(not process["down"]))
    yield Reading("process_silent_seconds", label, process["silent_s"])
    yield Reading("process_restarts", label, process["restarts"])
    yield Reading("process_cpu_seconds", label, process["cpu_s"])
    if "loop_lag_ms" in process:
        yield Reading("process_loop_lag_seconds", label, 1e-3 * process["loop_lag_ms"])
    if "skipped_bytes" in process:
        yield Reading("process_skipped_bytes", label, process["skipped_bytes"])


def _of_recorder(recorder: Body) -> Iterator[Reading]:
    yield Reading("record_up", (), float(recorder["state"] == "ok"))
    yield Reading("record_bytes", (), recorder.get("bytes", 0))
    yield Reading("record_queue_bytes", (), recorder.get("queue", {}).get("bytes", 0))
    yield Reading("record_flush_age_seconds", (), recorder.get("flush_age", 0.0))
    for topic, n in recorder.get("drops", {}).items():
        yield Reading("record_dropped", (topic,), n)


def _of_alarms(status: Body) -> Iterator[Reading]:
    alarms = status.get("alarms", ())
    counts: dict[tuple[str, str], int] = {}
    for alarm in alarms:
        about = alarm["severity"], alarm["kind"]
        counts[about] = counts.get(about, 0) + 1
    for about, n in counts.items():
        yield Reading("alarms_active", about, n)
    yield Reading("alarms_acknowledged", (), sum(alarm.get("acknowledged") is not None for alarm in alarms))
    yield Reading("alarms_shelved", (), len(status.get("shelved", ())))


def lives_of(status: Body) -> Iterator[tuple[str, int | None, float]]:
    """Parts whose counts may be taken back: name, id of the process they run in, and a count that never falls."""
    pids = {name: process.get("pid") for name, process in status.get("processes", {}).items()}
    for name, source in status.get("sources", {}).items():
        yield f"source {name}", pids.get("collect"), source.get("received", 0)
    for name, outlet in status.get("sinks", {}).items():
        yield f"outlet {name}", pids.get("tell"), outlet.get("received", 0)
