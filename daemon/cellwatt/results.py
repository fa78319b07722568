"""Results of stages, alarms and events of the daemon."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

Severity = Literal["info", "warning", "error"]
VariantKey = str
"""Variant in which a task was run, e.g. ``speed=0.60``; two runs with the same key are comparable."""


@dataclass(frozen=True, slots=True)
class Interval:
    """A span in which the set of moving joints did not change.

    ``start``/``end`` ns UTC, ``moving`` 1-based joint numbers (empty: at rest), ``displacement`` rad per
    joint from start to end, ``pose`` rad per joint at the start, ``peak_speed`` rad/s per joint.
    ``number`` counts within the session. ``closed`` is false for the interval in progress (then ``end`` is
    the time of the last frame). ``complete`` is false if a gap in the frames cut it.
    """

    source: str
    number: int
    start: int
    end: int
    moving: tuple[int, ...]
    displacement: tuple[float, ...]
    pose: tuple[float, ...]
    peak_speed: tuple[float, ...]
    closed: bool = True
    complete: bool = True


@dataclass(frozen=True, slots=True)
class Task:
    """One repetition of a recurring sequence of intervals.

    ``name`` is stable within a session (``task_1``, … in order of first recognition) and ``signature`` is
    the same for the same motion in any session. ``speed`` is relative to the fastest variant so far.
    ``intervals`` are the numbers of its intervals in order.
    """

    source: str
    name: str
    signature: str
    variant: VariantKey
    speed: float
    start: int
    end: int
    intervals: tuple[int, ...]
    repetition: int


@dataclass(frozen=True, slots=True)
class Prediction:
    """A model's output for frames ``sequence`` …: ``time`` ns, one list of values per output channel."""

    model: str
    sequence: int
    time: tuple[int, ...]
    outputs: Mapping[str, tuple[float, ...]]
    units: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Energy:
    """Energy of one task by consumer.

    ``task``, ``variant`` and ``repetition`` are those of the ``Task`` that ended; ``start``/``end`` ns UTC. ``total``
    J was measured; ``groups`` J, one per consumer, add up to it, and ``unexplained`` is the remainder that no consumer
    accounts for. ``uncertainty`` J is the standard deviation of ``unexplained`` on a healthy arm.
    ``positive_mechanical`` J is the work of the motors without braking, ``motion_efficiency_percent`` its share of
    ``total``. ``total_per_part`` J is ``None`` if the settings do not say how many parts the task makes.
    ``group_uncertainty`` J is one standard deviation of each of ``groups``, whose errors are correlated; it is empty
    in older recordings.
    """

    source: str
    task: str
    variant: VariantKey
    repetition: int
    start: int
    end: int
    total: float
    groups: Mapping[str, float]
    uncertainty: float
    positive_mechanical: float
    motion_efficiency_percent: float
    total_per_part: float | None = None
    group_uncertainty: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class Alarm:
    """Message of an alarm: its raise, an update, or its clear (``active`` false).

    ``id`` is the same for raise, updates and clear. ``kind`` names the condition (``joint_fault``,
    ``encoder_fault``, ``source_down``, …). ``since`` ns UTC of the first evidence, ``time`` of this
    message. ``evidence`` holds figures with units in their keys. ``stage`` raised it; None: the daemon itself.
    """

    id: str
    kind: str
    severity: Severity
    active: bool
    since: int
    time: int
    statement: str
    source: str | None = None
    joint: int | None = None
    alternatives: tuple[int, ...] = ()
    interval: int | None = None
    evidence: Mapping[str, Any] = field(default_factory=dict)
    stage: str | None = None


Result = Interval | Task | Energy | Prediction | Alarm


@dataclass(frozen=True, slots=True)
class Event:
    """An event of a source or the daemon (connected, rebooted, clock reset, reloaded, …)."""

    time: int
    source: str | None
    kind: str
    text: str
    data: Mapping[str, Any] = field(default_factory=dict)


def series_of(item: Result | Event) -> str:
    """Series in which an item is numbered: its kind, for predictions with the model (``prediction/power``)."""
    kind = type(item).__name__.lower()
    return f"{kind}/{item.model}" if isinstance(item, Prediction) else kind
