"""Converts a cell's messages to JSON for browsers: times in UTC ms, only the fields that the page shows. Pure."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from cellwatt.alarms import Acknowledgement, Shelf, Standing
from cellwatt.frames import Frames, Layout
from cellwatt.results import Alarm, Energy, Event, Interval, Prediction, Task

DIGITS = 7
"""Significant digits of a continuous value in a stream; other values are exact."""
_ALARM = (
    "id", "kind", "severity", "active", "statement", "source", "joint", "alternatives", "interval", "evidence", "stage",
)  # fmt: skip
_SPANS: Final[Mapping[type[Interval | Task | Energy], tuple[str, ...]]] = {
    Interval: ("source", "number", "moving", "closed"),
    Task: ("source", "name", "variant", "speed", "repetition"),
    Energy: (
        "task", "variant", "repetition", "total", "groups", "group_uncertainty", "uncertainty",
        "motion_efficiency_percent", "total_per_part",
    ),
}  # fmt: skip


def ms(time: int | None) -> float | None:
    """UTC ns as UTC ms."""
    return None if time is None else time / 1e6


def alarm(message: Alarm, acknowledged: Acknowledgement | None, evidence_page: str | None) -> dict[str, Any]:
    """An alarm, with its acknowledgement and the address of its evidence."""
    return {
        **{name: getattr(message, name) for name in _ALARM},
        "since": ms(message.since),
        "time": ms(message.time),
        "acknowledged": None if acknowledged is None else _person(acknowledged),
        "evidence_page": evidence_page,
    }


def shelved(standing: Standing) -> dict[str, Any]:
    """A shelved alarm."""
    message, shelf = standing.alarm, standing.shelf
    assert shelf is not None
    about = {name: getattr(message, name) for name in ("id", "kind", "severity", "statement")}
    until = {"until": ms(shelf.until), "severity": shelf.severity}
    return {**about, "since": ms(message.since), "shelf": {**_person(shelf), **until}}


def mark(message: Alarm, raised: int, cleared: int | None) -> dict[str, Any]:
    """An alarm as a mark in curves; times UTC ns, ``cleared`` is ``None`` while the alarm is active."""
    about = {name: getattr(message, name) for name in ("id", "severity", "statement")}
    return {**about, "raised": ms(raised), "cleared": ms(cleared)}


def _person(word: Acknowledgement | Shelf) -> dict[str, Any]:
    return {"name": word.name, "note": word.note, "time": ms(word.time)}


def span(item: Interval | Task | Energy) -> dict[str, Any]:
    """An interval, a task, or the energy, J by consumer, of one cycle of a task."""
    about = {name: getattr(item, name) for name in _SPANS[type(item)]}
    return {**about, "start": ms(item.start), "end": ms(item.end)}


def event(item: Event) -> dict[str, Any]:
    """An event of a source or the daemon."""
    return {"t": ms(item.time), "source": item.source, "kind": item.kind, "text": item.text, "data": item.data}


def prediction(model: str, items: Sequence[Prediction]) -> dict[str, Any]:
    """Messages of one model with the same outputs, merged into one."""
    values = {name: [v for item in items for v in item.outputs[name]] for name in items[0].outputs}
    return {"model": model, "t": [ms(time) for item in items for time in item.time], "v": values}


def channels(layout: Layout) -> list[dict[str, str]]:
    """The channels of frames."""
    return [{"name": c.name, "unit": c.unit, "kind": c.kind, "source": c.source} for c in layout.channels]


def frames(blocks: Iterable[Frames], wanted: Sequence[str]) -> dict[str, Any]:
    """Merge blocks of the same layout: times, values of the wanted channels, and the worst quality per channel."""
    parts = list(blocks)
    layout = parts[0].layout
    column_of = {name: i for i, name in enumerate(layout.names)}
    names = [name for name in wanted if name in column_of]
    columns = [column_of[name] for name in names]
    values = np.concatenate([part.values[:, columns] for part in parts])
    worst = np.concatenate([part.quality[:, columns] for part in parts]).max(axis=0, initial=0)
    rounded = [i for i, column in enumerate(columns) if layout.channels[column].kind == "continuous"]
    values[:, rounded] = significant(values[:, rounded])
    return {
        "t": (np.concatenate([part.time for part in parts]) / 1e6).tolist(),
        "v": dict(zip(names, values.T.tolist(), strict=True)),
        "q": dict(zip(names, worst.tolist(), strict=True)),
    }


def significant(values: NDArray[np.float64], digits: int = DIGITS) -> NDArray[np.float64]:
    """Values rounded to ``digits`` significant digits, which halves their size as text."""
    known = np.isfinite(values) & (values != 0)
    size = np.floor(np.log10(np.abs(np.where(known, values, 1.0))))
    scale = 10.0 ** np.clip(digits - 1 - size, -300, 300)
    return np.where(known, np.round(values * scale) / scale, values)
