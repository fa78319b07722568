"""All metrics of a cell: names, types, units, labels, help; and their values, read from its health. Pure."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final, Literal, NamedTuple

Type = Literal["counter", "gauge", "info"]


@dataclass(frozen=True, slots=True)
class Family:
    """One metric: ``name`` without ``_total`` and ``_info``, ``unit`` its last word where it has one."""

    name: str
    type: Type
    help: str
    labels: tuple[str, ...] = ()
    unit: str = ""

    @property
    def told(self) -> str:
        """Name of its samples."""
        return self.name + {"counter": "_total", "info": "_info", "gauge": ""}[self.type]


def _counter(name: str, text: str, *labels: str, unit: str = "") -> Family:
    return Family(f"cellwatt_{name}", "counter", text, labels, unit)


def _gauge(name: str, text: str, *labels: str, unit: str = "") -> Family:
    return Family(f"cellwatt_{name}", "gauge", text, labels, unit)


_FAMILIES: Final = (
    Family("cellwatt_build", "info", "Version of cellwatt.", ("version",)),
    _gauge("session_start_time_seconds", "UTC time at which the daemon started.", unit="seconds"),
    _gauge("state", "1 for the colour of the cell's health: green, amber or red.", "state"),
    _gauge("health_age_seconds", "Time since the cell's health was last looked at.", unit="seconds"),
    _gauge("utc_error_seconds", "Error of the cell's clock against this PC's UTC.", unit="seconds"),
    _counter("results", "Results of stages and alarms that were told."),
    # sources
    _gauge("source_up", "1 if the source delivers, 0 if it starts or is tried again.", "source"),
    _counter("samples_expected", "Samples that a source made, or that were due.", "source"),
    _counter("samples_received", "Samples that entered the record.", "source"),
    _counter("samples_missed", "Samples that were due and did not arrive in time.", "source", "reason"),
    _counter("samples_dropped", "Samples that arrived and were dropped.", "source", "reason"),
    _counter("samples_lost", "Samples missed or dropped, for whatever reason.", "source"),
    _gauge("samples_unaccounted", "Expected samples neither received, missed nor dropped; 0 if all is well.", "source"),
    _counter("source_occurrences", "Reconnects, retries, late answers and whatever else is counted.", "source", "what"),
    _gauge("stream_rate_hertz", "Measured rate of a stream.", "source", "stream", unit="hertz"),
    _gauge("stream_nominal_hertz", "Declared rate of a stream.", "source", "stream", unit="hertz"),
    _gauge("clock_bound_seconds", "Bound of the error of sample times.", "source", "stream", unit="seconds"),
    _counter("clock_resets", "Resets of the model of a device's clock.", "source", "stream"),
    # frames and what is made of them
    _counter("frames", "Frames made."),
    _counter("frame_samples_unused", "Samples that came too late or early for their frame.", "stream", "reason"),
    _gauge("power_watts", "Power of a channel in the newest frame.", "channel", unit="watts"),
    _counter(
        "energy_joules", "Energy of finished tasks by consumer, as far as above zero.", "task", "group", unit="joules"
    ),
    _counter("energy_returned_joules", "Energy that a consumer gave back, below zero.", "task", "group", unit="joules"),
    _counter("energy_measured_joules", "Measured energy of finished tasks.", "task", unit="joules"),
    _counter("task_repetitions", "Finished tasks whose energy is known.", "task"),
    _gauge("alarms_active", "Alarms that are up.", "severity", "kind"),
    _gauge("alarms_acknowledged", "Alarms that are up and acknowledged."),
    _gauge("alarms_shelved", "Alarms on the shelf."),
    _gauge("stage_up", "1 if the stage works, 0 if it broke.", "stage"),
    _counter("stage_frames", "Frames that a stage took.", "stage"),
    _counter("stage_results", "Results that a stage gave.", "stage"),
    _counter("stage_failures", "Times that a stage broke.", "stage"),
    _counter("stage_frames_dropped", "Frames dropped in front of a stage that is too slow.", "stage"),
    _gauge("stage_frames_waiting", "Frames that wait for a stage.", "stage"),
    _gauge("stage_mean_seconds", "Mean time that a stage takes for a frame.", "stage", unit="seconds"),
    _gauge("stage_slowest_seconds", "Longest time that a stage took for a block of frames.", "stage", unit="seconds"),
    # the daemon's own parts
    _gauge("sink_up", "1 if the outlet serves.", "sink"),
    _counter("sink_received", "Items that an outlet delivered.", "sink"),
    _counter("sink_missed", "Items that an outlet could not deliver.", "sink", "reason"),
    _counter("sink_dropped", "Items that an outlet dropped.", "sink", "reason"),
    _counter("sink_lost", "Items that an outlet missed or dropped, for whatever reason.", "sink"),
    _counter("sink_occurrences", "Retries and whatever else an outlet counts.", "sink", "what"),
    _gauge("process_up", "1 if the process says that it lives.", "process"),
    _gauge("process_silent_seconds", "Time since the process last said anything.", "process", unit="seconds"),
    _counter("process_restarts", "Times that the process was started again.", "process"),
    _counter("process_cpu_seconds", "Time that the process computed.", "process", unit="seconds"),
    _gauge("process_loop_lag_seconds", "Lateness of the process' event loop.", "process", unit="seconds"),
    _counter("process_skipped_bytes", "Bytes overwritten before the process read them.", "process", unit="bytes"),
    _gauge("record_up", "1 if the record can be written."),
    _counter("record_bytes", "Bytes written to the record.", unit="bytes"),
    _gauge("record_queue_bytes", "Bytes that wait to be written.", unit="bytes"),
    _gauge("record_flush_age_seconds", "Time since anything was written.", unit="seconds"),
    _counter("record_dropped", "Items that the record refused.", "topic"),
    # the metrics themselves
    _gauge("series_left_out", "Series of a metric that are beyond the most that is told.", "metric"),
    _counter("scrapes", "Answers with metrics."),
)
CATALOGUE: Final[Mapping[str, Family]] = {family.name: family for family in _FAMILIES}
"""Metrics by name, in the order in which they are told."""
LABELS: Final = frozenset(label for family in _FAMILIES for label in family.labels) | {
    "job",
    "instance",
    "le",
    "quantile",
}
"""Labels that no constant label may be called."""


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
