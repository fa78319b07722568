"""All metrics of a cell: names, types, units, labels, help; and their values, taken from health. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple

Type = Literal["counter", "gauge", "info"]


@dataclass(frozen=True, slots=True)
class Family:
    """One metric: ``name`` without ``_total`` and ``_info``; ``unit``: the last word of the name, or empty."""

    name: str
    type: Type
    help: str
    labels: tuple[str, ...] = ()
    unit: str = ""


def _counter(name: str, text: str, *labels: str, unit: str = "") -> Family:
    return Family(f"cellwatt_{name}", "counter", text, labels, unit)


def _gauge(name: str, text: str, *labels: str, unit: str = "") -> Family:
    return Family(f"cellwatt_{name}", "gauge", text, labels, unit)


_FAMILIES: Final = (
    Family("cellwatt_build", "info", "Version of cellwatt.", ("version",)),
    _gauge("session_start_time_seconds", "UTC time at which the daemon started.", unit="seconds"),
    _gauge("state", "1 for the colour of the cell's health: green, amber or red.", "state"),
    _gauge("health_age_seconds", "Age of the cell's health.", unit="seconds"),
    _gauge("utc_error_seconds", "Error of the cell's clock against this PC's UTC.", unit="seconds"),
    _counter("results", "Results of stages and alarms that were published."),
    # sources
    _gauge("source_up", "1 if the source delivers, 0 if it starts or reconnects.", "source"),
    _counter("samples_expected", "Samples that a source delivered, or that were due.", "source"),
    _counter("samples_received", "Samples that entered the record.", "source"),
    _counter("samples_missed", "Samples that were due and did not arrive in time.", "source", "reason"),
    _counter("samples_dropped", "Samples that arrived and were dropped.", "source", "reason"),
    _counter("samples_lost", "Samples missed or dropped, for any reason.", "source"),
    _gauge("samples_unaccounted", "Expected samples neither received, missed nor dropped; 0 if all is well.", "source"),
    _counter("source_occurrences", "Reconnects, retries, late answers and other counted events.", "source", "what"),
    _gauge("stream_rate_hertz", "Measured rate of a stream.", "source", "stream", unit="hertz"),
    _gauge("stream_nominal_hertz", "Declared rate of a stream.", "source", "stream", unit="hertz"),
    _gauge("clock_bound_seconds", "Largest error of sample times.", "source", "stream", unit="seconds"),
    _counter("clock_resets", "Resets of the model of a device's clock.", "source", "stream"),
    # frames and results
    _counter("frames", "Frames made."),
    _counter("frame_samples_unused", "Samples that arrived too late or too early for their frame.", "stream", "reason"),
    _gauge("power_watts", "Power of a channel in the newest frame.", "channel", unit="watts"),
    _counter("energy_joules", "Positive energy of finished tasks by consumer.", "task", "group", unit="joules"),
    _counter("energy_returned_joules", "Energy that a consumer returned.", "task", "group", unit="joules"),
    _counter("energy_measured_joules", "Measured energy of finished tasks.", "task", unit="joules"),
    _counter("task_repetitions", "Finished tasks whose energy is known.", "task"),
    _gauge("alarms_active", "Active alarms.", "severity", "kind"),
    _gauge("alarms_acknowledged", "Active alarms that are acknowledged."),
    _gauge("alarms_shelved", "Shelved alarms."),
    _gauge("stage_up", "1 if the stage works, 0 if it failed.", "stage"),
    _counter("stage_frames", "Frames that a stage processed.", "stage"),
    _counter("stage_results", "Results of a stage.", "stage"),
    _counter("stage_failures", "Failures of a stage.", "stage"),
    _counter("stage_frames_dropped", "Frames dropped because a stage is too slow.", "stage"),
    _gauge("stage_frames_waiting", "Frames that wait for a stage.", "stage"),
    _gauge("stage_mean_seconds", "Mean processing time of a frame in a stage.", "stage", unit="seconds"),
    _gauge("stage_slowest_seconds", "Longest processing time of a block of frames.", "stage", unit="seconds"),
    # outlets, processes, recorder
    _gauge("sink_up", "1 if the outlet serves.", "sink"),
    _counter("sink_received", "Items that an outlet delivered.", "sink"),
    _counter("sink_missed", "Items that an outlet could not deliver.", "sink", "reason"),
    _counter("sink_dropped", "Items that an outlet dropped.", "sink", "reason"),
    _counter("sink_lost", "Items that an outlet missed or dropped, for any reason.", "sink"),
    _counter("sink_occurrences", "Retries and other events that an outlet counts.", "sink", "what"),
    _gauge("process_up", "1 if the process responds.", "process"),
    _gauge("process_silent_seconds", "Time since the process last responded.", "process", unit="seconds"),
    _counter("process_restarts", "Restarts of the process.", "process"),
    _counter("process_cpu_seconds", "Processor time of the process.", "process", unit="seconds"),
    _gauge("process_loop_lag_seconds", "Lateness of the process' event loop.", "process", unit="seconds"),
    _counter("process_skipped_bytes", "Bytes overwritten before the process read them.", "process", unit="bytes"),
    _gauge("record_up", "1 if the record can be written."),
    _counter("record_bytes", "Bytes written to the record.", unit="bytes"),
    _gauge("record_queue_bytes", "Bytes waiting to be written.", unit="bytes"),
    _gauge("record_flush_age_seconds", "Time since the last write.", unit="seconds"),
    _counter("record_dropped", "Items that the record refused.", "topic"),
    # the metrics themselves
    _gauge("series_left_out", "Series of a metric beyond the limit, not published.", "metric"),
    _counter("scrapes", "Scrapes answered."),
)
CATALOGUE: Final[Mapping[str, Family]] = {family.name: family for family in _FAMILIES}
"""Metrics by name, in the order of the output."""

Body = Mapping[str, Any]
STATES: Final = ("green", "amber", "red")


class SeriesValue(NamedTuple):
    """Value of one series; ``metric`` is a name of the catalogue without ``cellwatt_``, ``labels`` in its order.

    ``part``: name of the source or outlet if the count decreases when a late sample arrives.
    """

    metric: str
    labels: tuple[str, ...]
    value: float
    part: str | None = None


_FIGURES: Final[Mapping[str, tuple[tuple[str, str, float], ...]]] = {
    "sources": (("samples_expected", "expected", 1.0), ("samples_unaccounted", "residue", 1.0)),
    "streams": (("stream_nominal_hertz", "nominal_hz", 1.0), ("stream_rate_hertz", "rate_hz", 1.0)),
    "clocks": (("clock_bound_seconds", "bound_ns", 1e-9), ("clock_resets", "resets", 1.0)),
    "stages": (
        ("stage_frames", "frames", 1.0), ("stage_results", "results", 1.0), ("stage_failures", "failures", 1.0),
        ("stage_frames_dropped", "dropped", 1.0), ("stage_frames_waiting", "waiting", 1.0),
        ("stage_mean_seconds", "mean_us_per_frame", 1e-6), ("stage_slowest_seconds", "slowest_ms", 1e-3),
    ),
    "processes": (
        ("process_silent_seconds", "silent_s", 1.0), ("process_restarts", "restarts", 1.0),
        ("process_cpu_seconds", "cpu_s", 1.0), ("process_loop_lag_seconds", "loop_lag_ms", 1e-3),
        ("process_skipped_bytes", "skipped_bytes", 1.0),
    ),
}  # fmt: skip
"""Metrics by section of health: (name, key in the section, factor to the metric's unit)."""


def of_health(status: Body) -> Iterator[SeriesValue]:
    """All series values of a health message."""
    for state in STATES:
        yield SeriesValue("state", (state,), float(status.get("state") == state))
    yield SeriesValue("utc_error_seconds", (), 1e-3 * status.get("utc_error_ms", 0.0))
    yield SeriesValue("results", (), status.get("results", 0))
    for kind, up in (("sources", "source_up"), ("stages", "stage_up"), ("sinks", "sink_up")):
        for name, part in status.get(kind, {}).items():
            yield SeriesValue(up, (name,), float(part["state"] == "ok"))
            yield from _figures(kind, (name,), part)
    for name, source in status.get("sources", {}).items():
        yield from _of_account("samples", "source", name, source)
        for kind in ("streams", "clocks"):
            for stream, part in source.get(kind, {}).items():
                yield from _figures(kind, (name, stream), part)
    for name, outlet in status.get("sinks", {}).items():
        yield from _of_account("sink", "outlet", name, outlet)
    for name, process in status.get("processes", {}).items():
        yield SeriesValue("process_up", (name,), float(not process["down"]))
        yield from _figures("processes", (name,), process)
    frames = status.get("frames", {})
    yield SeriesValue("frames", (), frames.get("count", 0))
    for stream, counts in frames.get("streams", {}).items():
        for reason, n in counts.items():
            yield SeriesValue("frame_samples_unused", (stream, reason), n)
    if (recorder := status.get("recorder")) is not None:
        yield from _of_recorder(recorder)
    yield from _of_alarms(status)


def _figures(kind: str, labels: tuple[str, ...], part: Body) -> Iterator[SeriesValue]:
    """The figures present in one entry of health."""
    for metric, key, factor in _FIGURES.get(kind, ()):
        if (value := part.get(key)) is not None:
            yield SeriesValue(metric, labels, factor * value)


def _of_account(kind: str, part: str, name: str, account: Body) -> Iterator[SeriesValue]:
    life = f"{part} {name}"
    missed, dropped = account.get("missed", {}), account.get("dropped", {})
    yield SeriesValue(f"{kind}_received", (name,), account.get("received", 0))
    yield SeriesValue(f"{kind}_lost", (name,), sum(missed.values()) + sum(dropped.values()), life)
    for reason, n in missed.items():
        yield SeriesValue(f"{kind}_missed", (name, reason), n, life)
    for where, n in dropped.items():
        yield SeriesValue(f"{kind}_dropped", (name, where), n)
    for what, n in account.get("counters", {}).items():
        yield SeriesValue("source_occurrences" if part == "source" else "sink_occurrences", (name, what), n)


def _of_recorder(recorder: Body) -> Iterator[SeriesValue]:
    yield SeriesValue("record_up", (), float(recorder["state"] == "ok"))
    yield SeriesValue("record_bytes", (), recorder.get("bytes", 0))
    yield SeriesValue("record_queue_bytes", (), recorder.get("queue", {}).get("bytes", 0))
    yield SeriesValue("record_flush_age_seconds", (), recorder.get("flush_age", 0.0))
    for topic, n in recorder.get("drops", {}).items():
        yield SeriesValue("record_dropped", (topic,), n)


def _of_alarms(status: Body) -> Iterator[SeriesValue]:
    alarms = status.get("alarms", ())
    for about, n in Counter((alarm["severity"], alarm["kind"]) for alarm in alarms).items():
        yield SeriesValue("alarms_active", about, n)
    yield SeriesValue("alarms_acknowledged", (), sum(alarm.get("acknowledged") is not None for alarm in alarms))
    yield SeriesValue("alarms_shelved", (), len(status.get("shelved", ())))


def lives_of(status: Body) -> Iterator[tuple[str, int | None, float]]:
    """Sources and outlets whose counts may decrease: (name, id of their process, a count that never decreases)."""
    pids = {name: process.get("pid") for name, process in status.get("processes", {}).items()}
    for name, source in status.get("sources", {}).items():
        yield f"source {name}", pids.get("collect"), source.get("received", 0)
    for name, outlet in status.get("sinks", {}).items():
        yield f"outlet {name}", pids.get("tell"), outlet.get("received", 0)
