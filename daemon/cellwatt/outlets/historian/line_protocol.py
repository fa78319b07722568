"""Rows and results in InfluxDB's line protocol. Pure.

A backslash in tags and names becomes a slash, as version 1 has no way to write one in front of a comma or at the end;
a line break there becomes a blank.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Final

import pydantic_core

from cellwatt.outlets.past import Archived
from cellwatt.outlets.selection import Row
from cellwatt.results import Alarm, Energy, Task

Value = float | int | bool | str

_KEY: Final = {ord(c): f"\\{c}" for c in ",= "} | {ord("\\"): "/", ord("\n"): "\\ ", ord("\r"): "\\ "}
_MEASUREMENT: Final = {**_KEY, ord("="): "="}
_TEXT: Final = {ord('"'): '\\"', ord("\\"): "\\\\"}
_LONGEST: Final = 4000
"""Characters of a text; version 1 refuses more than 64 kB."""


def line(measurement: str, tags: Mapping[str, str | None], fields: Mapping[str, Value | None], time: int) -> str:
    """One point at ``time``, UTC ns; empty where no field has a value. Tags without a value are left out."""
    values = {key: text for key, value in fields.items() if (text := _value(value))}
    if not values:
        return ""
    body = ",".join(f"{_word(key)}={text}" for key, text in values.items())
    return f"{_series(measurement, tags)} {body} {time}"


def row_line(measurement: str, tags: Mapping[str, str], row: Row) -> str:
    """A row: its channels as fields, and ``quality``, the worst of the values that are there."""
    values = row.values
    fields = [f"{_word(name)}={value!r}" for name, value in values.items() if math.isfinite(value)]
    if not fields:
        return ""
    worst = max(quality for name, quality in row.quality.items() if name in values)
    return f"{_series(measurement, tags)} {','.join(fields)},quality={worst}i {row.time}"


def result_line(measurement: str, tags: Mapping[str, str], result: Archived) -> str:
    """An alarm, task or energy, in the measurement with ``_alarm``, ``_task`` or ``_energy`` behind it."""
    match result:
        case Alarm():
            more = {key: getattr(result, key) for key in ("id", "kind", "severity", "source", "stage")}
            fields = {key: getattr(result, key) for key in ("active", "since", "statement", "joint")}
            evidence = pydantic_core.to_json(dict(result.evidence), inf_nan_mode="null", fallback=str).decode()
            return line(f"{measurement}_alarm", {**tags, **more}, {**fields, "evidence": evidence}, result.time)
        case Task():
            more = {"source": result.source, "task": result.name, "variant": result.variant}
            seconds = (result.end - result.start) * 1e-9
            told = {"speed": result.speed, "seconds": seconds, "repetition": result.repetition}
            return line(f"{measurement}_task", {**tags, **more}, {**told, "signature": result.signature}, result.end)
        case Energy():
            return _energy(f"{measurement}_energy", tags, result)


def _energy(measurement: str, tags: Mapping[str, str], energy: Energy) -> str:
    more = {"source": energy.source, "task": energy.task, "variant": energy.variant}
    names = ("total", "uncertainty", "positive_mechanical", "motion_efficiency_percent", "repetition")
    fields: dict[str, Any] = {name: getattr(energy, name) for name in names}
    fields |= {f"group.{name}": value for name, value in energy.groups.items()}
    return line(measurement, {**tags, **more}, fields, energy.end)


def _series(measurement: str, tags: Mapping[str, str | None]) -> str:
    words = [f"{_word(key)}={_word(value)}" for key, value in sorted(tags.items()) if value]
    return ",".join((measurement.translate(_MEASUREMENT), *words))


@lru_cache(4096)
def _word(text: str) -> str:
    """A name or tag: the same ones come again and again."""
    return text.translate(_KEY)


def _value(value: Value | None) -> str:
    """A field's value as text; empty where line protocol has none for it."""
    match value:
        case bool():
            return "true" if value else "false"
        case int():
            return f"{value}i"
        case float():
            return repr(float(value)) if math.isfinite(value) else ""
        case str():
            return f'"{value[:_LONGEST].translate(_TEXT)}"'
        case None:
            return ""
