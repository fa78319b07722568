"""Texts of messages, the same for every channel. Pure."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, tzinfo
from typing import Any, Final

from pydantic_core import to_jsonable_python

from cellwatt.outlets.notify.rules import Item, Notification, rank
from cellwatt.results import Alarm
from cellwatt.units import figure_named

LONGEST_SUBJECT: Final = 160  # characters
LONGEST_STATEMENT: Final = 1000
FIGURES: Final = 12
"""Most figures of evidence in one message."""
_OVER: Final = ("Resolved", "Withdrawn")


@dataclass(frozen=True, slots=True)
class About:
    """The cell that messages are about: its names, address of its page, time zone of recipients (None: of this PC)."""

    site: str
    cell: str
    page: str | None = None
    zone: tzinfo | None = None

    @property
    def link(self) -> str | None:
        """Address of this cell's alarms on the page."""
        return None if self.page is None else f"{self.page.rstrip('/')}/cell/{self.site}/{self.cell}/alarms"


def subject(about: About, message: Notification) -> str:
    """One line: the cell, and its most severe alarm."""
    return short(f"[{about.site}/{about.cell}] {_headline(message)}", LONGEST_SUBJECT)


def body(about: About, message: Notification, limit: int | None = None) -> str:
    """The text under the subject, at most ``limit`` bytes; items that do not fit are counted."""
    if not message.items and not message.more:
        lines = [f"This is a test. Alarms of the cell {about.cell} at {about.site} will be sent to this recipient."]
    elif len(message.items) == 1 and not message.more:
        lines = list(_whole(about, message.items[0]))
    else:
        lines = list(_list(about, message, limit))
    if about.link is not None:
        lines += ["", about.link]
    text = "\n".join(lines) + "\n"
    return text if limit is None or len(text.encode()) <= limit else _cut(text, limit)


def payload(about: About, message: Notification) -> dict[str, Any]:
    """A complete message for programs, JSON-ready."""
    return {
        "id": message.id,
        "site": about.site,
        "cell": about.cell,
        "made": utc(message.made).isoformat(),
        "severity": severity(message),
        "subject": subject(about, message),
        "text": body(about, message),
        "page": about.link,
        "alarms": [{"happened": item.what, **_plain(item.alarm)} for item in message.items],
        "more": message.more,
    }


def undelivered(about: About, to: str, message: Notification, reason: str, now: str) -> bytes:
    """One line of the undelivered file, for a message to ``to`` given up at ``now``."""
    return json.dumps({"time": now, "to": to, "reason": reason, **payload(about, message)}).encode() + b"\n"


def severity(message: Notification) -> str | None:
    """Highest severity among the active alarms; ``None`` if all are cleared."""
    up = [item.alarm for item in message.items if item.what != "cleared"]
    return max(up, key=rank).severity if up else None


def utc(ns: int) -> datetime:
    """Datetime of UTC ns, in whole seconds."""
    return datetime.fromtimestamp(ns // 10**9, UTC)


def in_order(items: Sequence[Item]) -> list[Item]:
    """Items in reading order: active alarms first, the most severe first."""
    return sorted(items, key=lambda item: (item.what == "cleared", -rank(item.alarm)))


def _headline(message: Notification) -> str:
    items = in_order(message.items)
    if not items:
        return f"{message.more} alarms" if message.more else "test: cellwatt reaches you"
    rest = len(items) - 1 + message.more
    first = _summary(items[0])
    return f"{first} (and {rest} more)" if rest else first


def _summary(item: Item) -> str:
    statement = short(item.alarm.statement, LONGEST_STATEMENT)
    match item.what:
        case "cleared":
            return statement if statement.startswith(_OVER) else f"over: {statement}"
        case "graver":
            return f"now {item.alarm.severity}: {statement}"
        case "repeated":
            return f"still {item.alarm.severity}: {statement}"
        case _:
            return f"{item.alarm.severity}: {statement}"


def _whole(about: About, item: Item) -> Iterator[str]:
    alarm = item.alarm
    yield short(alarm.statement, LONGEST_STATEMENT)
    yield ""
    if item.what == "cleared":
        yield f"over:     {_when(about, alarm.time)}"
    else:
        yield f"severity: {alarm.severity}"
    yield f"since:    {_when(about, alarm.since)}"
    if alarm.joint is not None:
        yield f"joint:    {alarm.joint}{f' of {alarm.source}' if alarm.source else ''}"
    elif alarm.source:
        yield f"source:   {alarm.source}"
    if alarm.alternatives:
        joints = ", ".join(map(str, alarm.alternatives))
        yield f"or:       joint {joints}, which explains the evidence as well"
    if figures := list(evidence(alarm.evidence)):
        yield f"evidence: {', '.join(figures)}"
    yield f"alarm:    {short(alarm.id, LONGEST_STATEMENT)}"


def _list(about: About, message: Notification, limit: int | None) -> Iterator[str]:
    items = in_order(message.items)
    room = None if limit is None else limit - 200 - len((about.link or "").encode())
    yield f"{_count(len(items) + message.more)}:"
    yield ""
    for number, item in enumerate(items):
        line = f"- {_summary(item)} (since {_when(about, item.alarm.since)})"
        if room is not None and (room := room - len(line.encode()) - 1) < 0:
            yield f"and {len(items) - number + message.more} more"
            return
        yield line
    if message.more:
        yield f"and {message.more} more"


def evidence(figures: Mapping[str, Any]) -> Iterator[str]:
    """Figures of an alarm as text, ``residual 38 W`` for ``residual_W``; at most twelve."""
    stated = 0
    for key, value in figures.items():
        if stated == FIGURES:
            return
        name, unit = figure_named(str(key))
        if isinstance(value, bool) or not isinstance(value, int | float | str):
            continue
        stated += 1
        shown = f"{value:.4g}" if isinstance(value, float) else str(value)
        yield short(f"{name} {shown}{f' {unit}' if unit else ''}", 80)


def _when(about: About, ns: int) -> str:
    at = utc(ns)
    local = at.astimezone(about.zone)
    if local.utcoffset() == at.utcoffset():
        return f"{at:%Y-%m-%d %H:%M:%S} UTC"
    day = "" if local.date() == at.date() else f"{local:%Y-%m-%d} "
    return f"{at:%Y-%m-%d %H:%M:%S} UTC ({day}{local:%H:%M:%S} {local.tzname()})"


def _count(number: int) -> str:
    return f"{number} alarm{'' if number == 1 else 's'}"


def _plain(alarm: Alarm) -> dict[str, Any]:
    plain: dict[str, Any] = to_jsonable_python(asdict(alarm), inf_nan_mode="null", fallback=str)
    return plain


def short(text: str, longest: int) -> str:
    """A text in one line of at most ``longest`` characters."""
    text = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return text if len(text) <= longest else text[: longest - 1] + "…"


def _cut(text: str, limit: int) -> str:
    return text.encode()[: limit - 4].decode(errors="ignore") + "…\n"
