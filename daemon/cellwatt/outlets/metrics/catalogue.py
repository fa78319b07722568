"""All metrics of a cell: names, types, units, labels, help. Nothing is told that is not declared here."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, Literal

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
